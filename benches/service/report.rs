//! What was measured, as a Markdown table, and whether it keeps what is promised.

/// Rows of the table: what, measured, promised.
#[derive(Default)]
pub(crate) struct Report {
    rows: Vec<[String; 3]>,
    broken: Vec<String>,
}

impl Report {
    pub(crate) fn row(&mut self, what: &str, measured: &str) {
        self.rows
            .push([what.to_owned(), measured.to_owned(), String::new()]);
    }

    /// A row of one number that must stay below a limit.
    pub(crate) fn bounded(&mut self, what: &str, measured: f64, limit: f64, unit: &str) {
        self.rows.push([
            what.to_owned(),
            format!("{measured:.1} {unit}"),
            format!("< {limit} {unit}"),
        ]);
        if measured >= limit {
            let broken = format!("{what}: {measured:.1} {unit}, promised < {limit} {unit}");
            self.broken.push(broken);
        }
    }

    /// The table.
    pub(crate) fn table(&self) -> String {
        let rows = self.rows.iter().map(|row| row.join(" | "));
        let rows: Vec<_> = rows.map(|row| format!("| {row} |\n")).collect();
        format!(
            "| what | measured | promised |\n|---|---|---|\n{}",
            rows.concat()
        )
    }

    /// Writes the rows to `target/bench/service.json`.
    pub(crate) fn save(&self) -> std::io::Result<()> {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/target/bench");
        let rows = self.rows.iter().map(|[what, measured, promised]| {
            serde_json::json!({"what": what, "measured": measured, "promised": promised})
        });
        let rows = rows.collect::<serde_json::Value>();
        std::fs::create_dir_all(folder)?;
        std::fs::write(format!("{folder}/service.json"), format!("{rows:#}\n"))
    }

    /// What was promised and not kept.
    pub(crate) fn broken(&self) -> &[String] {
        &self.broken
    }
}

/// Measured durations in milliseconds.
#[derive(Default)]
pub(crate) struct Sample(Vec<f64>);

impl Sample {
    pub(crate) fn push(&mut self, ms: f64) {
        self.0.push(ms);
    }

    pub(crate) fn append(&mut self, mut other: Self) {
        self.0.append(&mut other.0);
    }

    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    /// The smallest value that at least this share of the sample does not exceed.
    pub(crate) fn quantile(&mut self, share: f64) -> f64 {
        assert!(!self.0.is_empty(), "nothing was measured");
        self.0.sort_by(f64::total_cmp);
        let rank = (share * self.0.len() as f64).ceil() as usize;
        self.0[rank.clamp(1, self.0.len()) - 1]
    }

    /// Median and 99th percentile, for a row.
    pub(crate) fn summary(&mut self) -> String {
        let (median, high) = (self.quantile(0.5), self.quantile(0.99));
        format!(
            "p50 {median:.1} ms, p99 {high:.1} ms ({} times)",
            self.len()
        )
    }
}

"""The figures of a run as Markdown, and as CSV."""

import csv
import statistics

import halves
import names

OURS, PEER = "meshway", "Open3D Poisson"

# Column: key of a row, and how its mean is written.
MEANS = {
    "Chamfer": ("chamfer", "{:.4f}"),
    "Hausdorff-95": ("hausdorff_95", "{:.4f}"),
    "normals": ("normals", "{:.4f}"),
    "seconds": ("seconds", "{:.1f}"),
    "CPU seconds": ("cpu_seconds", "{:.1f}"),
    "memory, MB": ("memory_mb", "{:.0f}"),
}
RIGHT = {"closed": "manifold", "pieces": "right_pieces", "genus": "right_genus"}

TITLES = {halves.CHOSEN_ON: "Chosen on", halves.SHOWN_ON: "Shown on"}


def done(row):
    return row is not None and row.get("chamfer") is not None


def best(rows, tool):
    """Of each cloud the row of `tool`: of several settings that with the least Chamfer."""
    chosen = {}
    for row in rows:
        if row["tool"] == tool:
            known = chosen.get(row["cloud"])
            if not done(known) or done(row) and row["chamfer"] < known["chamfer"]:
                chosen[row["cloud"]] = row
    return chosen


def geometric(values):
    return statistics.geometric_mean(values) if values else None


def means(rows):
    """Geometric means; of normals, of what is missing to 1."""
    result = {key: geometric([row[key] for row in rows]) for key, _ in MEANS.values() if key != "normals"}
    missing = geometric([max(1 - row["normals"], 1e-9) for row in rows])
    return result | {"normals": None if missing is None else 1 - missing}


def ratios(ours, theirs):
    if ours["chamfer"] is None:
        return dict.fromkeys(ours)
    result = {key: ours[key] / theirs[key] for key in ours}
    return result | {"normals": (1 - ours["normals"]) / (1 - theirs["normals"])}


def cells(values, form=None):
    return ["" if values[key] is None else (form or own).format(values[key]) for key, own in MEANS.values()]


def line(*parts):
    return "| " + " | ".join(str(part) for part in parts) + " |"


def classes(rows):
    return sorted({(row["size"], row["noise"]) for row in rows})


def noise_title(noise):
    return f"{noise:g} %" if noise else "clean"


def of_half(rows, half):
    """Geometric means by class. Where both tools ran they are of the clouds that both did."""
    rows = [row for row in rows if row["half"] == half]
    shapes = sorted({row["shape"] for row in rows}, key=halves.order)
    if not rows:
        return ""
    lines = [
        f"### {TITLES[half]}: {', '.join(shapes)}", "",
        line("points", "noise", "tool", *MEANS, "clouds", *RIGHT), "|" + "---|" * (len(MEANS) + len(RIGHT) + 4),
    ]
    for size, noise in classes(rows):
        some = [row for row in rows if (row["size"], row["noise"]) == (size, noise)]
        ran = {tool: chosen for tool in (OURS, PEER) if (chosen := best(some, tool))}
        common = set.intersection(*({cloud for cloud, row in chosen.items() if done(row)} for chosen in ran.values()))
        sums = {}
        for tool, chosen in ran.items():
            sums[tool] = means([chosen[cloud] for cloud in sorted(common)])
            made = [row for row in chosen.values() if done(row)]
            counts = [sum(bool(row[key]) for row in made) for key in RIGHT.values()]
            title = f"**{tool}**" if tool == OURS else tool
            lines.append(
                line(f"{size:,}", noise_title(noise), title, *cells(sums[tool]), f"{len(made)} of {len(chosen)}", *counts)
            )
        if len(sums) == 2:
            ratio = cells(ratios(sums[OURS], sums[PEER]), "{:.2f}")
            ahead = sum(ran[OURS][cloud]["chamfer"] < ran[PEER][cloud]["chamfer"] for cloud in common)
            lines.append(line("", "", "ratio", *ratio, f"ahead on {ahead} of {len(common)}", *[""] * len(RIGHT)))
    return "\n".join(lines) + "\n"


def each(rows):
    """A line a cloud and tool."""
    lines = [
        line("cloud", "tool", *MEANS, "pieces", "genus", ""), "|" + "---|" * (len(MEANS) + 5),
    ]
    chosen = {tool: best(rows, tool) for tool in (OURS, PEER)}
    order = {row["cloud"]: (row["size"], row["noise"], *halves.order(row["shape"])) for row in rows}
    for cloud in sorted(order, key=order.get):
        for tool, of_tool in chosen.items():
            if row := of_tool.get(cloud):
                title = f"{tool} {row['depth']}" if row.get("depth") else tool
                if not done(row):
                    lines.append(line(cloud, title, *[""] * (len(MEANS) + 2), row["problem"]))
                    continue
                notes = [] if row["manifold"] else ["closed, not manifold" if row["closed"] else "open"]
                notes += [row["verdict"]] if row.get("verdict") else []
                genus = "" if row["genus"] is None else row["genus"]
                lines.append(line(cloud, title, *cells(row), row["components"], genus, ", ".join(notes)))
    return "\n".join(lines) + "\n"


def write_csv(path, rows):
    columns = list(dict.fromkeys(key for row in rows for key in row))
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)


def short(row):
    """A row on one line, to follow a run."""
    title = f"{names.cloud(row['shape'], row['size'], row['noise'])} {row['tool']} {row.get('depth', '')}".strip()
    if not done(row):
        return f"{title}: {row['problem']}"
    return (
        f"{title}: Chamfer {row['chamfer']:.4f}, normals {row['normals']:.4f}, {row['seconds']:.1f} s, "
        f"CPU {row['cpu_seconds']:.1f} s, {row['memory_mb']:.0f} MB, {row['components']} pieces, genus {row['genus']}"
    )

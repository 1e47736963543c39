//! Names in the character sets of DICOM (PS3.3, C.12.1.1.2; PS3.5, 6.1.2).

use std::borrow::Cow;

use encoding_rs::{
    EUC_JP, EUC_KR, Encoding, GB18030, GBK, ISO_8859_2, ISO_8859_3, ISO_8859_4, ISO_8859_5,
    ISO_8859_6, ISO_8859_7, ISO_8859_8, ISO_8859_15, SHIFT_JIS, UTF_8, WINDOWS_874, WINDOWS_1252,
    WINDOWS_1254,
};

use super::element::DataSet;
use super::tags;

const ESCAPE: u8 = 0x1b;

/// By the number of its registration: what bytes from 0x80 on stand for. Where the one that DICOM means is a part
/// of a larger one, it is the larger.
const BY_NUMBER: [(&str, &Encoding); 18] = [
    ("100", WINDOWS_1252),
    ("101", ISO_8859_2),
    ("109", ISO_8859_3),
    ("110", ISO_8859_4),
    ("144", ISO_8859_5),
    ("127", ISO_8859_6),
    ("126", ISO_8859_7),
    ("138", ISO_8859_8),
    ("148", WINDOWS_1254),
    ("203", ISO_8859_15),
    ("13", SHIFT_JIS),
    ("166", WINDOWS_874),
    ("149", EUC_KR),
    ("58", GBK),
    ("192", UTF_8),
    ("GB18030", GB18030),
    ("GBK", GBK),
    // Japanese in the lower half, which escapes name before each use.
    ("87", EUC_JP),
];

/// What a sequence of bytes behind an escape changes (PS3.3, tables C.12-3 and C.12-4).
const ESCAPES: [(&[u8], Change); 19] = [
    (b"(B", Change::Lower(Lower::Ascii)),
    (b"(J", Change::Lower(Lower::Ascii)),
    (b"$B", Change::Lower(Lower::Kanji)),
    (b"$@", Change::Lower(Lower::Kanji)),
    (b"$(D", Change::Lower(Lower::MoreKanji)),
    (b"-A", Change::Upper(WINDOWS_1252)),
    (b"-B", Change::Upper(ISO_8859_2)),
    (b"-C", Change::Upper(ISO_8859_3)),
    (b"-D", Change::Upper(ISO_8859_4)),
    (b"-L", Change::Upper(ISO_8859_5)),
    (b"-G", Change::Upper(ISO_8859_6)),
    (b"-F", Change::Upper(ISO_8859_7)),
    (b"-H", Change::Upper(ISO_8859_8)),
    (b"-M", Change::Upper(WINDOWS_1254)),
    (b"-b", Change::Upper(ISO_8859_15)),
    (b"-T", Change::Upper(WINDOWS_874)),
    (b")I", Change::Upper(SHIFT_JIS)),
    (b"$)C", Change::Upper(EUC_KR)),
    (b"$)A", Change::Upper(GBK)),
];

#[derive(Clone, Copy)]
enum Change {
    Lower(Lower),
    Upper(&'static Encoding),
}

/// What bytes below 0x80 stand for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Lower {
    Ascii,
    /// Two bytes a character, of JIS X 0208.
    Kanji,
    /// Two bytes a character, of JIS X 0212.
    MoreKanji,
}

/// What the bytes of names stand for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Charset {
    /// From 0x80 on, before any escape; none where the file does not say it.
    first: Option<&'static Encoding>,
}

impl Charset {
    /// That which a data set names.
    pub(super) fn of(data_set: &DataSet<'_>) -> Self {
        Self::named(&data_set.text(tags::CHARACTER_SET))
    }

    /// That of `SpecificCharacterSet`; of several values the first tells how a name begins, escapes the others.
    fn named(values: &str) -> Self {
        let first = values.split('\\').next().unwrap_or_default().trim();
        // Some programs write `ISO-IR`, `ISO 2022 IR` and `ISO_IR` are both right.
        let number = first.rsplit([' ', '_', '-']).next().unwrap_or_default();
        let known = BY_NUMBER.iter().find(|(name, _)| *name == number);
        Self {
            first: known.map(|(_, encoding)| *encoding),
        }
    }

    /// A name as UTF-8; as it is where the file does not say what it is in.
    pub(super) fn utf8(self, bytes: &[u8]) -> Cow<'_, [u8]> {
        let escapes = bytes.contains(&ESCAPE);
        if !escapes && (self.first.is_none() || bytes.is_ascii()) {
            return Cow::Borrowed(bytes);
        }
        let (mut lower, mut upper) = (Lower::Ascii, self.first.unwrap_or(WINDOWS_1252));
        let mut text = String::new();
        let mut parts = bytes.split(|&b| b == ESCAPE);
        text.push_str(&decoded(parts.next().unwrap_or_default(), lower, upper));
        for part in parts {
            let known = ESCAPES.iter().find(|(mark, _)| part.starts_with(mark));
            let rest = match known {
                Some((mark, change)) => {
                    match *change {
                        Change::Lower(changed) => lower = changed,
                        Change::Upper(changed) => upper = changed,
                    }
                    &part[mark.len()..]
                }
                None => part,
            };
            text.push_str(&decoded(rest, lower, upper));
        }
        Cow::Owned(text.into_bytes())
    }
}

/// The text of bytes without escapes.
fn decoded(bytes: &[u8], lower: Lower, upper: &'static Encoding) -> String {
    if lower == Lower::Ascii {
        return upper.decode_without_bom_handling(bytes).0.into_owned();
    }
    // The same characters with the highest bits set are those of EUC, where the second set has a mark before each.
    let mut raised = Vec::with_capacity(2 * bytes.len());
    for pair in bytes.chunks(2) {
        if lower == Lower::MoreKanji {
            raised.push(0x8f);
        }
        raised.extend(pair.iter().map(|b| b | 0x80));
    }
    EUC_JP.decode_without_bom_handling(&raised).0.into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(values: &str, bytes: &[u8]) -> String {
        let text = Charset::named(values).utf8(bytes);
        String::from_utf8(text.into_owned()).unwrap()
    }

    #[test]
    fn the_examples_of_the_standard_are_read() {
        // PS3.5, annexes H to K.
        let kanji =
            b"Yamada^Tarou=\x1b$B;3ED\x1b(B^\x1b$BB@O:\x1b(B=\x1b$B$d$^$@\x1b(B^\x1b$B$?$m$&\x1b(B";
        assert_eq!(
            read("\\ISO 2022 IR 87", kanji),
            "Yamada^Tarou=山田^太郎=やまだ^たろう"
        );
        let katakana = b"\xd4\xcf\xc0\xde^\xc0\xdb\xb3=\x1b$B;3ED\x1b(J^\x1b$BB@O:\x1b(J";
        assert_eq!(
            read("ISO 2022 IR 13\\ISO 2022 IR 87", katakana),
            "ﾔﾏﾀﾞ^ﾀﾛｳ=山田^太郎"
        );
        let hangul = b"Hong^Gildong=\x1b$)C\xfb\xf3^\x1b$)C\xd1\xce\xd4\xd7=\x1b$)C\xc8\xab^\x1b$)C\xb1\xe6\xb5\xbf";
        assert_eq!(
            read("\\ISO 2022 IR 149", hangul),
            "Hong^Gildong=洪^吉洞=홍^길동"
        );
        assert_eq!(read("ISO_IR 192", "Wang^小东".as_bytes()), "Wang^小东");
        let chinese = b"Wang^XiaoDong=\xcd\xf5^\xd0\xa1\xb6\xab=";
        assert_eq!(read("GB18030", chinese), "Wang^XiaoDong=王^小东=");
        let simplified = b"Zhang^XiaoDong=\x1b$)A\xd5\xc5^\x1b$)A\xd0\xa1\xb6\xab=";
        assert_eq!(
            read("\\ISO 2022 IR 58", simplified),
            "Zhang^XiaoDong=张^小东="
        );
    }

    #[test]
    fn sets_of_one_byte_are_read_with_and_without_escapes() {
        for (values, bytes, text) in [
            (
                "ISO_IR 144",
                b"\xbf\xd5\xe7\xd5\xdd\xec".as_slice(),
                "Печень",
            ),
            ("ISO 2022 IR 144", b"\xbf\xd5\xe7\xd5\xdd\xec", "Печень"),
            ("ISO_IR 100", b"Sch\xe4del", "Schädel"),
            ("ISO_IR 126", b"\xd0\xd0\xc1\xf1", "ΠΠΑρ"),
            ("ISO_IR 148", b"kemi\xf0i", "kemiği"),
            (
                "\\ISO 2022 IR 144",
                b"liver \x1b-L\xbf\xd5\xe7\xd5\xdd\xec",
                "liver Печень",
            ),
            ("\\ISO 2022 IR 159", b"\x1b$(D\x22\x2f\x1b(B.", "˘."),
        ] {
            assert_eq!(read(values, bytes), text, "{values}");
        }
    }

    #[test]
    fn what_is_not_said_stays_as_it_is() {
        for (values, bytes) in [
            ("", b"Sch\xe4del".as_slice()),
            ("ISO_IR 9999", b"\xff\xfe"),
            ("", b"bone"),
        ] {
            assert_eq!(Charset::named(values).utf8(bytes), bytes);
        }
        // Of a byte that stands for nothing a mark is left, and no name fails.
        assert_eq!(read("GB18030", b"a\xff"), "a\u{fffd}");
        assert_eq!(read("", b"\x1b?x"), "?x");
    }
}

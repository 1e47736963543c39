//! The known word that a mistyped one was meant to be.

/// The one of `known` that `word` is closest to, if slips of the keyboard explain the difference:
/// one in a short word, one in every four letters of a long one.
pub(crate) fn nearest<'k>(word: &str, known: impl IntoIterator<Item = &'k str>) -> Option<&'k str> {
    let distance = |known: &str| strsim::damerau_levenshtein(word, known);
    known
        .into_iter()
        .map(|known| (distance(known), known))
        .filter(|(distance, known)| *distance <= (known.len() / 4).max(1))
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, known)| known)
}

/// The question that ends a message about an unknown word; nothing where no known one is close.
pub(crate) fn did_you_mean<'k>(word: &str, known: impl IntoIterator<Item = &'k str>) -> String {
    nearest(word, known).map_or_else(String::new, |known| format!("; did you mean {known}?"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_understood_and_other_words_are_not() {
        let known = ["sphere", "torus", "hand", "hw"];
        for (word, meant) in [
            ("spere", Some("sphere")),
            ("SPHERE", None),
            ("trous", Some("torus")),
            ("hv", Some("hw")),
            ("uterus", None),
            ("", None),
        ] {
            assert_eq!(nearest(word, known), meant, "{word}");
        }
    }
}

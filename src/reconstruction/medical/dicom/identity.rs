//! Whose examination a data set is of.

use super::charset::Charset;
use super::element::DataSet;
use super::tags;
use crate::reconstruction::slices::Identifiers;

/// Most characters of a value: those of a name in three alphabets.
const LONGEST: usize = 3 * 64;

/// Patient, study and frame of reference of a data set.
pub(super) fn identifiers(data_set: &DataSet<'_>) -> Identifiers {
    let charset = Charset::of(data_set);
    let text = |tag| {
        let bytes = charset.utf8(data_set.bytes(tag));
        let text = String::from_utf8_lossy(&bytes);
        let clean = text.chars().filter(|c| !c.is_control()).take(LONGEST);
        clean.collect::<String>().trim().to_owned()
    };
    Identifiers {
        patient_name: text(tags::PATIENT_NAME),
        patient_id: text(tags::PATIENT_ID),
        patient_birth_date: text(tags::PATIENT_BIRTH_DATE),
        patient_sex: text(tags::PATIENT_SEX),
        study_uid: text(tags::STUDY),
        study_id: text(tags::STUDY_ID),
        study_date: text(tags::STUDY_DATE),
        study_time: text(tags::STUDY_TIME),
        accession_number: text(tags::ACCESSION_NUMBER),
        referring_physician: text(tags::REFERRING_PHYSICIAN),
        frame_of_reference_uid: text(tags::FRAME_OF_REFERENCE),
    }
}

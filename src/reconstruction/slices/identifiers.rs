//! What names the patient and the examination in a DICOM file: kept only where the user asks for it.

use serde::{Deserialize, Serialize};

/// Patient, study and frame of reference, as text in the notation of DICOM; empty where the file has none.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Identifiers {
    /// Patient's Name (0010,0010).
    pub patient_name: String,
    /// Patient ID (0010,0020).
    pub patient_id: String,
    /// Patient's Birth Date (0010,0030).
    pub patient_birth_date: String,
    /// Patient's Sex (0010,0040).
    pub patient_sex: String,
    /// Study Instance UID (0020,000D).
    pub study_uid: String,
    /// Study ID (0020,0010).
    pub study_id: String,
    /// Study Date (0008,0020).
    pub study_date: String,
    /// Study Time (0008,0030).
    pub study_time: String,
    /// Accession Number (0008,0050).
    pub accession_number: String,
    /// Referring Physician's Name (0008,0090).
    pub referring_physician: String,
    /// Frame of Reference UID (0020,0052).
    pub frame_of_reference_uid: String,
}

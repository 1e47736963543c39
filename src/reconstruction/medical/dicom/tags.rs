//! The tags that are looked at, as group and element in one number.

pub(super) const TRANSFER_SYNTAX: u32 = 0x0002_0010;
pub(super) const CHARACTER_SET: u32 = 0x0008_0005;
pub(super) const SOP_CLASS: u32 = 0x0008_0016;
pub(super) const STUDY_DATE: u32 = 0x0008_0020;
pub(super) const STUDY_TIME: u32 = 0x0008_0030;
pub(super) const ACCESSION_NUMBER: u32 = 0x0008_0050;
pub(super) const MODALITY: u32 = 0x0008_0060;
pub(super) const REFERRING_PHYSICIAN: u32 = 0x0008_0090;
pub(super) const PATIENT_NAME: u32 = 0x0010_0010;
pub(super) const PATIENT_ID: u32 = 0x0010_0020;
pub(super) const PATIENT_BIRTH_DATE: u32 = 0x0010_0030;
pub(super) const PATIENT_SEX: u32 = 0x0010_0040;
pub(super) const STUDY: u32 = 0x0020_000d;
pub(super) const STUDY_ID: u32 = 0x0020_0010;
pub(super) const IMAGE_POSITION: u32 = 0x0020_0032;
pub(super) const IMAGE_ORIENTATION: u32 = 0x0020_0037;
pub(super) const FRAME_OF_REFERENCE: u32 = 0x0020_0052;
pub(super) const PLANE_POSITION_SEQUENCE: u32 = 0x0020_9113;
pub(super) const PLANE_ORIENTATION_SEQUENCE: u32 = 0x0020_9116;
pub(super) const FRAMES: u32 = 0x0028_0008;
pub(super) const ROWS: u32 = 0x0028_0010;
pub(super) const COLUMNS: u32 = 0x0028_0011;
pub(super) const SLICE_THICKNESS: u32 = 0x0018_0050;
pub(super) const PIXEL_SPACING: u32 = 0x0028_0030;
pub(super) const BITS_ALLOCATED: u32 = 0x0028_0100;
pub(super) const PIXEL_PADDING: u32 = 0x0028_0120;
pub(super) const PIXEL_MEASURES_SEQUENCE: u32 = 0x0028_9110;
pub(super) const TOTAL_PIXEL_MATRIX_COLUMNS: u32 = 0x0048_0006;
pub(super) const PLANE_POSITION_SLIDE_SEQUENCE: u32 = 0x0048_021a;
pub(super) const SEGMENTATION_TYPE: u32 = 0x0062_0001;
pub(super) const SEGMENT_SEQUENCE: u32 = 0x0062_0002;
pub(super) const SEGMENT_NUMBER: u32 = 0x0062_0004;
pub(super) const SEGMENT_LABEL: u32 = 0x0062_0005;
pub(super) const SEGMENT_IDENTIFICATION_SEQUENCE: u32 = 0x0062_000a;
pub(super) const REFERENCED_SEGMENT: u32 = 0x0062_000b;
pub(super) const RECOMMENDED_COLOR: u32 = 0x0062_000d;
pub(super) const MAXIMUM_FRACTION: u32 = 0x0062_000e;
pub(super) const STRUCTURE_SEQUENCE: u32 = 0x3006_0020;
pub(super) const ROI_NUMBER: u32 = 0x3006_0022;
pub(super) const ROI_NAME: u32 = 0x3006_0026;
pub(super) const ROI_COLOR: u32 = 0x3006_002a;
pub(super) const ROI_CONTOUR_SEQUENCE: u32 = 0x3006_0039;
pub(super) const CONTOUR_SEQUENCE: u32 = 0x3006_0040;
pub(super) const CONTOUR_TYPE: u32 = 0x3006_0042;
pub(super) const CONTOUR_DATA: u32 = 0x3006_0050;
pub(super) const REFERENCED_ROI: u32 = 0x3006_0084;
pub(super) const SHARED_GROUPS: u32 = 0x5200_9229;
pub(super) const FRAME_GROUPS: u32 = 0x5200_9230;
pub(super) const PIXEL_DATA: u32 = 0x7fe0_0010;

pub(super) const ITEM: u32 = 0xfffe_e000;
pub(super) const ITEM_END: u32 = 0xfffe_e00d;
pub(super) const SEQUENCE_END: u32 = 0xfffe_e0dd;

/// Sequences that implicit data sets, which name no types, are searched for.
pub(super) const SEQUENCES: &[u32] = &[
    PLANE_POSITION_SEQUENCE,
    PLANE_ORIENTATION_SEQUENCE,
    PIXEL_MEASURES_SEQUENCE,
    PLANE_POSITION_SLIDE_SEQUENCE,
    SEGMENT_SEQUENCE,
    SEGMENT_IDENTIFICATION_SEQUENCE,
    STRUCTURE_SEQUENCE,
    ROI_CONTOUR_SEQUENCE,
    CONTOUR_SEQUENCE,
    SHARED_GROUPS,
    FRAME_GROUPS,
];

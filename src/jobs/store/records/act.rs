//! What the audit trail tells of, and how it went.

/// Writes the acts and their names.
macro_rules! acts {
    ($($(#[$doc:meta])* $act:ident $action:literal $event:literal;)*) => {
        /// What can be done, as far as the audit trail tells of it.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum Act {
            $($(#[$doc])* $act,)*
        }

        impl Act {
            /// Its letter, as in DICOM and FHIR: C, R, U, D, or E for all else.
            pub(super) fn action(self) -> &'static str {
                match self { $(Self::$act => $action,)* }
            }

            /// Its name.
            pub fn name(self) -> &'static str {
                match self { $(Self::$act => $event,)* }
            }
        }
    };
}

acts! {
    /// A cloud was uploaded.
    CloudCreate "C" "cloud.create";
    /// A cloud was uploaded whose bytes the tenant has already.
    CloudMatch "E" "cloud.match";
    /// The bytes or points of a cloud were fetched.
    CloudRead "R" "cloud.read";
    /// How long a cloud is kept was changed.
    CloudKeep "U" "cloud.keep";
    /// A cloud is held from then on.
    CloudHold "U" "cloud.hold";
    /// A cloud is held no more.
    CloudRelease "U" "cloud.release";
    /// A cloud was erased.
    CloudDelete "D" "cloud.delete";
    /// An upload was begun that may go on after it was cut.
    UploadCreate "C" "upload.create";
    /// Such an upload was erased.
    UploadDelete "D" "upload.delete";
    /// A job was submitted.
    JobCreate "C" "job.create";
    /// The end of a job was asked for.
    JobCancel "U" "job.cancel";
    /// How long a job is kept, or when it has its turn, was changed.
    JobKeep "U" "job.keep";
    /// A job is held from then on, and its cloud with it.
    JobHold "U" "job.hold";
    /// A job is held no more.
    JobRelease "U" "job.release";
    /// A job was erased with its results.
    JobDelete "D" "job.delete";
    /// Jobs were submitted together.
    BatchCreate "C" "batch.create";
    /// The end of all jobs of a batch was asked for.
    BatchCancel "U" "batch.cancel";
    /// The last job of a batch was erased, and the batch with it.
    BatchDelete "D" "batch.delete";
    /// A mesh, a snapshot or a mask was fetched.
    MeshRead "R" "mesh.read";
    /// A network, which has the surface in it, was fetched.
    ModelRead "R" "model.read";
    /// Values of a field, which has the surface in it, were fetched.
    FieldRead "R" "field.read";
    /// The audit trail was read.
    AuditRead "R" "audit.read";
    /// A key was made.
    KeyCreate "C" "key.create";
    /// A key was taken out of use.
    KeyDelete "D" "key.delete";
    /// A webhook was made.
    WebhookCreate "C" "webhook.create";
    /// A webhook was changed, or got a new secret.
    WebhookChange "U" "webhook.change";
    /// A webhook was removed.
    WebhookDelete "D" "webhook.delete";
    /// A message to a webhook was asked for: a test, or one that was sent before.
    WebhookSend "E" "webhook.send";
    /// Somebody signed in with a password.
    SessionCreate "E" "session.create";
    /// Somebody without a good key was refused.
    AuthFail "E" "auth.fail";
    /// The holder of a key was refused for want of a scope.
    AuthDeny "E" "auth.deny";
}

/// How it went, as in DICOM and FHIR.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// It was done.
    Done,
    /// It was refused.
    Refused,
}

impl Outcome {
    pub(super) fn number(self) -> i64 {
        match self {
            Self::Done => 0,
            Self::Refused => 8,
        }
    }
}

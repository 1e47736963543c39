//! The elements that a header declares, in the types of the readers.

use ply_rs::ply::{ElementDef, PropertyDef, PropertyType, ScalarType};

use crate::reconstruction::cloud::Error;
use crate::reconstruction::cloud::binary::Scalar;
use crate::reconstruction::cloud::columns::Columns;
use crate::reconstruction::cloud::text::excerpt;

/// How the values of a property are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::reconstruction) enum Kind {
    /// One number.
    Scalar(Scalar),
    /// A length, which is an integer, and as many items.
    List(Scalar, Scalar),
}

/// A column of an element.
#[derive(Debug)]
pub(in crate::reconstruction) struct Property {
    pub(in crate::reconstruction) name: String,
    pub(in crate::reconstruction) kind: Kind,
}

/// A table of the file.
#[derive(Debug)]
pub(in crate::reconstruction) struct Element {
    pub(in crate::reconstruction) name: String,
    /// Records, as declared.
    pub(in crate::reconstruction) count: usize,
    /// One or more.
    pub(in crate::reconstruction) properties: Vec<Property>,
}

impl Element {
    /// The element of a definition of `ply-rs`.
    pub(super) fn new(definition: &ElementDef) -> Result<Self, Error> {
        let properties = definition.properties.values().map(property);
        Ok(Self {
            name: definition.name.clone(),
            count: definition.count,
            properties: properties.collect::<Result<_, _>>()?,
        })
    }

    /// Whether these are the vertices.
    pub(in crate::reconstruction) fn is_vertex(&self) -> bool {
        self.name.eq_ignore_ascii_case("vertex")
    }

    /// Bytes of one record; `None` if lists make them vary.
    pub(super) fn record_bytes(&self) -> Option<usize> {
        let size = |property: &Property| match property.kind {
            Kind::Scalar(scalar) => Some(scalar.size()),
            Kind::List(..) => None,
        };
        self.properties.iter().map(size).sum()
    }

    /// What the columns of a vertex hold; lists are none that could be used.
    pub(super) fn columns(&self) -> Option<Columns> {
        let name = |property: &'_ Property| match property.kind {
            Kind::Scalar(_) => property.name.clone(),
            Kind::List(..) => String::new(),
        };
        let names: Vec<String> = self.properties.iter().map(name).collect();
        Columns::named(names.iter().map(String::as_bytes))
    }

    /// The file ends after `found` records.
    pub(super) fn truncated(&self, found: usize) -> Error {
        Error::Truncated {
            what: format!("element {}", excerpt(self.name.as_bytes())),
            declared: self.count as u64,
            found: found as u64,
        }
    }
}

fn property(definition: &PropertyDef) -> Result<Property, Error> {
    let kind = match &definition.data_type {
        PropertyType::Scalar(of) => Kind::Scalar(scalar(of)),
        PropertyType::List(length, of) => Kind::List(scalar(length), scalar(of)),
    };
    if matches!(kind, Kind::List(length, _) if !length.is_integer()) {
        return Err(Error::Header {
            line: 0,
            detail: "the length of a list must be an integer".to_owned(),
        });
    }
    let name = definition.name.clone();
    Ok(Property { name, kind })
}

fn scalar(of: &ScalarType) -> Scalar {
    match of {
        ScalarType::Char => Scalar::I8,
        ScalarType::UChar => Scalar::U8,
        ScalarType::Short => Scalar::I16,
        ScalarType::UShort => Scalar::U16,
        ScalarType::Int => Scalar::I32,
        ScalarType::UInt => Scalar::U32,
        ScalarType::Float => Scalar::F32,
        ScalarType::Double => Scalar::F64,
    }
}

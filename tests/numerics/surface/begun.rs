//! Extractions that begin before all of the field is known.

use std::cell::RefCell;
use std::sync::Mutex;

use meshway::reconstruction::Error;
use meshway::reconstruction::random::{Generator, Purpose, stream};
use meshway::reconstruction::surface::{Begun, Field, Request, extract};
use meshway::reconstruction::vector::{Bounds, Vec3, norm};
use rand::RngExt;

use super::fields::{analytic, graded, sphere, torus};
use super::request;

/// A field that is known in some boxes only, and fails elsewhere.
struct Known<'a> {
    field: &'a dyn Field,
    boxes: Vec<Bounds>,
    /// Places that were asked for.
    asked: Mutex<usize>,
}

impl Known<'_> {
    fn check(&self, points: &[Vec3]) {
        let is_known = |p: &Vec3| self.boxes.iter().any(|known| known.contains(*p));
        let unknown = points.iter().find(|p| !is_known(p));
        assert_eq!(unknown, None);
        *self.asked.lock().unwrap() += points.len();
    }
}

impl Field for Known<'_> {
    fn values(&self, points: &[Vec3], values: &mut [f64]) -> Result<(), Error> {
        self.check(points);
        self.field.values(points, values)
    }

    fn values_and_gradients(
        &self,
        points: &[Vec3],
        values: &mut [f64],
        gradients: &mut [Vec3],
    ) -> Result<(), Error> {
        self.check(points);
        self.field.values_and_gradients(points, values, gradients)
    }
}

/// The numbers below `count` in some groups, one of which is left out.
fn shuffled(count: usize, groups: usize, random: &mut Generator) -> Vec<Vec<usize>> {
    let mut of_group = vec![Vec::new(); groups + 1];
    for number in 0..count {
        of_group[random.random_range(0..=groups)].push(number);
    }
    of_group.pop();
    of_group
}

#[test]
fn whatever_comes_first_the_extraction_is_the_same() {
    // Leaves the grid on one side.
    let cut = analytic(|p: Vec3| 0.9 - norm([p[0] - 0.4, p[1], p[2]]));
    let rough = analytic(|p: Vec3| {
        let ripple = 0.05 * (40.0 * p[0]).sin() * (37.0 * p[1]).sin();
        ((0.6 - norm(p) + ripple) * 30.0).tanh()
    });
    let ring = graded(torus(0.6, 0.2), 0.1);
    let fields: [&dyn Field; 4] = [&sphere(0.7), &cut, &rough, &ring];
    let mut random = stream(3, Purpose::Shape);
    for (field, resolution) in fields
        .into_iter()
        .flat_map(|field| [(field, 70), (field, 135)])
    {
        let whole = extract(field, &request(resolution, 2)).unwrap();
        for count in [1, 2, 7] {
            let told = RefCell::new(0);
            let request = Request {
                progress: &|_| *told.borrow_mut() += 1,
                ..request(resolution, 2)
            };
            let mut begun = Begun::new(&request).unwrap();
            let boxes = begun.parts(&request);
            for parts in shuffled(boxes.len(), count, &mut random) {
                let known = Known {
                    field,
                    boxes: parts.iter().map(|&part| boxes[part]).collect(),
                    asked: Mutex::new(0),
                };
                begun.go_on(&parts, &known, &request).unwrap();
                assert!(parts.iter().all(|&part| begun.is_sampled(part)));
                assert!(*known.asked.lock().unwrap() > 0 && told.take() > 0);
            }
            assert!((0..boxes.len()).any(|part| !begun.is_sampled(part)));
            assert_eq!(begun.finish(field, &request).unwrap(), whole);
        }
    }
}

#[test]
fn what_was_begun_is_not_asked_for_again() {
    let field = sphere(0.7);
    let request = request(135, 2);
    let mut begun = Begun::new(&request).unwrap();
    let parts: Vec<usize> = (0..begun.parts(&request).len()).collect();
    begun.go_on(&parts, &field, &request).unwrap();
    let nowhere = Known {
        field: &field,
        boxes: Vec::new(),
        asked: Mutex::new(0),
    };
    let extraction = begun.finish(&nowhere, &request).unwrap();
    assert_eq!(extraction, extract(&field, &request).unwrap());
}

#[test]
fn a_part_that_cannot_be_begun_says_why() {
    let request = request(70, 2);
    let parts = |begun: &Begun| (0..begun.parts(&request).len()).collect::<Vec<_>>();
    let mut begun = Begun::new(&request).unwrap();
    let nan = begun.go_on(&parts(&begun), &analytic(|_| f64::NAN), &request);
    assert!(matches!(nan, Err(Error::NoSurface(_))), "{nan:?}");
    let stopped = Request {
        cancelled: &|| true,
        ..request
    };
    let mut begun = Begun::new(&request).unwrap();
    let stopped = begun.go_on(&parts(&begun), &sphere(0.7), &stopped);
    assert!(matches!(stopped, Err(Error::Cancelled)), "{stopped:?}");
}

//! The mathematics: a point cloud in, a watertight mesh out.
//!
//! The data flows through `cloud`, `sampling`, `network`, `training`, `surface`, `mesh` and `quality`;
//! `plan` decides what is done, and `run` has the whole way in one screen. References used below:
//!
//! - \[N24\] Noorizadegan, Hon, Young, Chen: Highway Networks for Improved Surface Reconstruction:
//!   The Role of Residuals and Weight Updates, arXiv:2407.08134.
//! - \[NW06\] Nocedal, Wright: Numerical Optimization, 2nd edition, Springer 2006.
//! - \[LC87\] Lorensen, Cline: Marching Cubes, SIGGRAPH 1987.
//! - \[B18\] Barill, Dickson, Schmidt, Levin, Jacobson: Fast Winding Numbers for Soups and Clouds,
//!   SIGGRAPH 2018.
//! - \[H92\] Hoppe, DeRose, Duchamp, McDonald, Stuetzle: Surface Reconstruction from Unorganized
//!   Points, SIGGRAPH 1992.
//! - \[LSL24\] Lin, Shi, Liu: Fast and Globally Consistent Normal Orientation Based on the Winding Number
//!   Normal Consistency, ACM Transactions on Graphics 2024.
//! - \[GB10\] Glorot, Bengio: Understanding the Difficulty of Training Deep Feedforward Neural
//!   Networks, AISTATS 2010.
//! - \[KB15\] Kingma, Ba: Adam: A Method for Stochastic Optimization, ICLR 2015.

mod blocks;
mod cholesky;
pub mod cloud;
pub mod medical;
pub mod mesh;
mod model;
pub mod network;
pub mod plan;
pub mod quality;
pub mod random;
pub mod report;
pub mod sampling;
pub mod settings;
pub mod shapes;
pub mod slices;
pub mod space;
pub mod surface;
pub mod training;
pub mod vector;
pub mod verify;

mod coarse;
mod error;
mod mesher;
mod nearby;
mod observer;
mod run;
mod symmetric;
mod threads;

pub use blocks::{Block, BlockModel, ShareError, ShareRefusal, fit_share, processor};
pub use error::Error;
pub use model::{Model, ModelError};
pub use observer::{Event, Helpers, Observer, Phase, Warning};
pub use report::{Input, Report};
pub use run::{Reconstruction, reconstruct};
pub use settings::{Preset, Settings};
pub use threads::{in_pool, set_threads};

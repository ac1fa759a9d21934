//! Poses of many parts of one target.
//!
//! The sums of a part are those of its points. Noise and weights are taken from all points once, so
//! that another part costs little more than its additions.

use super::equation::{self, Equation, Weight};
use super::noise;
use super::normal::{Normal, Solution};
use super::quarter_turn::{QuarterTurn, Turned};
use super::{Estimate, LEAST_POINTS, Noise, Observation, Refusal, first_pass, middle};
use crate::sums::centred::Geometry;
use nalgebra::Vector3;

/// Target whose parts are estimated.
#[derive(Clone, Copy, Debug)]
pub struct Parts<'a> {
    geometry: &'a Geometry,
    first: QuarterTurn,
    middle: Vector3<f64>,
    /// Scale of the noise, and the Cholesky factor of the rest.
    noise: (f64, [[f64; 2]; 2]),
    /// First pass over all points; `None` for a target that does not turn.
    pass: Option<Solution>,
}

/// Point of the target with its share of the sums.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    start_mm: Vector3<f64>,
    equation: Equation,
    weight: Weight,
    sums: Normal,
}

impl<'a> Parts<'a> {
    /// Prepares the parts of the target with these points, by all stages of [`super::solve`] after
    /// the quarter turn `first`. Weights are those of the pose of all points.
    ///
    /// # Errors
    /// [`Refusal`], if all points together do not determine a rotation.
    pub fn of(
        first: QuarterTurn,
        geometry: &'a Geometry,
        observations: &[Observation],
    ) -> Result<Self, Refusal> {
        let all = observations;
        let turned = Turned { all, first };
        let noise = Noise::of_turned(geometry, &turned);
        let middle = middle(&turned)?;
        let pass = first_pass(geometry, &turned, Some(&noise), &middle)?;
        Ok(Self {
            geometry,
            first,
            middle,
            noise: noise.factor(),
            pass: Some(pass),
        })
    }

    /// Prepares the parts of a target that does not turn, by the stage [`super::plain`].
    ///
    /// # Errors
    /// [`Refusal`], if all points together do not determine a rotation.
    pub fn of_still(geometry: &'a Geometry, observations: &[Observation]) -> Result<Self, Refusal> {
        let first = QuarterTurn::default();
        let all = observations;
        let turned = Turned { all, first };
        Ok(Self {
            geometry,
            first,
            middle: middle(&turned)?,
            noise: Noise::of_turned(geometry, &turned).factor(),
            pass: None,
        })
    }

    /// Returns the share of a point; `None` if noise in some direction does not show in it.
    pub fn point(&self, observation: &Observation) -> Option<Point> {
        let start_mm = observation.start_mm();
        let observation = self.first.start(observation);
        let equation = Equation::new(&observation, &self.middle);
        let mut sums = Normal::default();
        let weight = match &self.pass {
            None => {
                let weight = Weight::still(self.geometry, &observation);
                sums.add(&equation, &weight, None);
                weight
            }
            Some(pass) => {
                let (_, factor) = &self.noise;
                let derivatives =
                    equation::noise(self.geometry, &observation, &self.middle, factor);
                let weight = Weight::of_noise(&derivatives, pass)?;
                sums.add(&equation, &weight, Some(&derivatives));
                weight
            }
        };
        Some(Point {
            start_mm,
            equation,
            weight,
            sums,
        })
    }

    /// Estimates the pose of a part.
    ///
    /// # Errors
    /// [`Refusal`], if its points do not determine a rotation.
    pub fn solve<'p>(
        &self,
        points: impl Iterator<Item = &'p Point> + Clone,
    ) -> Result<Estimate, Refusal> {
        let count = points.clone().count();
        if count < LEAST_POINTS {
            return Err(Refusal::TooFewPoints);
        }
        let mut sums = Normal::default();
        for point in points.clone() {
            sums.join(&point.sums);
        }
        let (scale, _) = self.noise;
        let solution = sums.solve(scale)?;
        let squares = points.clone().map(|point| {
            let residual = point.equation.residual(&solution);
            residual.dot(&(point.weight.0 * residual))
        });
        let variance = noise::variance(self.geometry, scale, squares.sum(), count);
        let start_mm = points.map(|point| point.start_mm).sum::<Vector3<f64>>() / count as f64;
        let first = self.first;
        Ok(Estimate::new(
            self.geometry,
            (first, start_mm),
            &self.middle,
            &solution,
            variance,
        ))
    }
}

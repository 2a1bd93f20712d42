//! The engine and its feed system stepped by themselves, under a valve angle.
#![allow(dead_code)]

use crate::bare_engine::{Vehicle, condition};
use hopbench::propulsion::{
    Engine, EngineCondition, FeedInput, FeedMap, FeedState, FeedStep, ImplicitMethod, Line, ManifoldModel,
    OperatingPoint, WarmStart,
};

pub fn with_manifold(vehicle: &mut Vehicle, volume_m3: f64) {
    vehicle.feed.manifold.model = ManifoldModel::Implicit;
    vehicle.feed.manifold.volume_m3 = volume_m3;
}

/// A line of the isolation valve's bore.
pub fn with_line(vehicle: &mut Vehicle, length_m: f64) {
    vehicle.feed.line = Some(Line { length_m, area_m2: 1.267e-4, static_head: false, drop_m: 0.0 });
}

/// The burning engine at R 35 mm and throat 10.0 mm, unless told otherwise.
pub struct Fed<'a> {
    pub engine: &'a Engine,
    pub feed: FeedMap,
    pub condition: EngineCondition,
    pub state: FeedState,
    pub point: OperatingPoint,
    pub head_pa: f64,
    guess: WarmStart,
}

impl<'a> Fed<'a> {
    pub fn at_rest(engine: &'a Engine, feed: FeedMap) -> Self {
        let condition = condition(35.0, 10.0);
        let point = engine.operating_point(&feed, 0.0, &condition, WarmStart::default());
        let state = engine.feed_at_rest(&feed, condition.ambient_pa);
        Self { engine, feed, condition, state, point, head_pa: 0.0, guess: WarmStart::default() }
    }

    pub fn steady(engine: &'a Engine, degrees: f64) -> Self {
        let mut fed = Self::at_rest(engine, engine.feed_map(65e5, 290.0));
        let area_m2 = engine.valve_area().area_m2(degrees.to_radians());
        fed.point = engine.operating_point(&fed.feed, area_m2, &fed.condition, WarmStart::default());
        fed.state = engine.feed_steady(&fed.feed, &fed.point);
        fed.guess = fed.point.warm_start;
        fed
    }

    /// One step, the valve moving from one angle to another.
    pub fn step(&mut self, from_deg: f64, to_deg: f64, dt_s: f64, method: ImplicitMethod) {
        let at = |degrees: f64| FeedInput {
            valve_area_m2: self.engine.valve_area().area_m2(degrees.to_radians()),
            head_pa: self.head_pa,
            condition: self.condition,
        };
        let step = FeedStep { from: self.state, start: at(from_deg), method };
        let next = self.engine.feed_point(&self.feed, &step, &at(to_deg), dt_s, self.guess);
        (self.state, self.point, self.guess) = (next.state, next.engine, next.engine.warm_start);
    }

    pub fn settle(&mut self, degrees: f64, dt_s: f64, steps: u32) {
        for _ in 0..steps {
            self.step(degrees, degrees, dt_s, ImplicitMethod::Sdirk2);
        }
    }
}

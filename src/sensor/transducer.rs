//! Pressure transducers of the propulsion system: a first-order lag, bias, noise, range.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::input::Invalid;
use crate::noise::{self, ChannelError, Stream};
use crate::signal::Pressures;
use crate::time::SimTime;

use super::Schedule;
use super::truth::Truth;

/// One pressure transducer: an entry `[[sensors.pressure_transducer]]`.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TransducerParameters {
    /// Which pressure it reads.
    pub name: Tap,
    /// Where it sits, structural frame (m); for the record, pressures are uniform where they are tapped.
    #[schemars(inner(range(min = -20.0, max = 20.0)))]
    pub position_m: [f64; 3],
    /// Sample rate, a divisor of 1000 (Hz).
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub rate_hz: f64,
    /// Least and greatest reading; beyond it is clamped.
    #[schemars(inner(range(min = 0.0, max = 1e9)))]
    pub range_pa: [f64; 2],
    /// White noise of one sample.
    #[schemars(range(min = 0.0, max = 1e7))]
    pub noise_std_pa: f64,
    /// Standard deviation of the bias, drawn once per run.
    #[schemars(range(min = 0.0, max = 1e7))]
    pub bias_std_pa: f64,
    /// Corner frequency of the first-order lag, of the cell or its sense tube (Hz).
    #[schemars(range(min = 0.1, max = 1e6))]
    pub bandwidth_hz: f64,
}

/// Where a pressure is tapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Tap {
    /// Run-tank ullage.
    Tank,
    /// Nitrogen bottle.
    Bottle,
    /// Injector inlet, P2.
    InjectorInlet,
    /// Combustion chamber.
    Chamber,
}

impl Tap {
    /// Stream names do not depend on the order of transducers in the file.
    fn stream_name(self) -> &'static str {
        match self {
            Self::Tank => "pressure_transducer.tank",
            Self::Bottle => "pressure_transducer.bottle",
            Self::InjectorInlet => "pressure_transducer.injector_inlet",
            Self::Chamber => "pressure_transducer.chamber",
        }
    }

    fn pressure_pa(self, truth: &Truth) -> f64 {
        match self {
            Self::Tank => truth.tank_pa,
            Self::Bottle => truth.bottle_pa,
            Self::InjectorInlet => truth.injector_inlet_pa,
            Self::Chamber => truth.chamber_pa,
        }
    }

    fn reading(self, pressures: &mut Pressures) -> &mut Option<f64> {
        match self {
            Self::Tank => &mut pressures.tank_pa,
            Self::Bottle => &mut pressures.bottle_pa,
            Self::InjectorInlet => &mut pressures.injector_inlet_pa,
            Self::Chamber => &mut pressures.chamber_pa,
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Transducer {
    schedule: Schedule,
    tap: Tap,
    range_pa: [f64; 2],
    /// Share of a pressure step that the lag lets through in one plant step, exact for a held input.
    follow: f64,
    lagged_pa: f64,
    error: ChannelError,
    stream: Stream,
}

impl Transducer {
    pub(super) fn new(
        parameters: &TransducerParameters,
        step: SimTime,
        initial: &Truth,
        seed: u64,
    ) -> Result<Self, Invalid> {
        let p = parameters;
        let mut stream = noise::stream(seed, p.name.stream_name());
        Ok(Self {
            schedule: Schedule::new(p.rate_hz)?,
            tap: p.name,
            range_pa: p.range_pa,
            follow: -libm::expm1(-core::f64::consts::TAU * p.bandwidth_hz * step.s()),
            lagged_pa: p.name.pressure_pa(initial),
            error: ChannelError::new(p.noise_std_pa, 0.0, p.bias_std_pa, &mut stream),
            stream,
        })
    }

    /// Every plant step, since the lag runs between samples too.
    pub(super) fn sample(&mut self, truth: &Truth, time: SimTime, pressures: &mut Pressures) {
        self.lagged_pa += self.follow * (self.tap.pressure_pa(truth) - self.lagged_pa);
        if let Some(elapsed) = self.schedule.due(time) {
            let reading_pa = self.lagged_pa + self.error.sample(elapsed.s(), &mut self.stream);
            *self.tap.reading(pressures) = Some(reading_pa.clamp(self.range_pa[0], self.range_pa[1]));
        }
    }
}

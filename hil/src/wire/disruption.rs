//! A bad wire: what faults of the wire and of the flight controller do to whole frames, in both directions,
//! between the link and the codec.
//!
//! Frames are lost, late, out of order, doubled or damaged as [`WireEffect`] says; bytes between frames pass
//! unless nothing does. Lateness is simulated time: in real time that is the wall's, and in lockstep, where
//! simulated time stands while the bench waits, a late frame holds nobody up. The bench then waits for the
//! answer to the newest sample that the wire has delivered by now, and an answer has come when it reaches the
//! wire, though what it says is obeyed only once it has passed. Of a loss the bench knows nothing: it waits
//! in vain, as it would on a real line.
//!
//! What happens to a frame is drawn from streams of the run's seed, six numbers a frame whatever is broken.
//! Samples and their answers have streams of their own, since only their order repeats from run to run;
//! heartbeats go by the wall clock.

use std::collections::BTreeMap;

use hopbench::fault::wire::{Direction, FcEffect, WireEffect};
use hopbench::noise::{self, Stream};
use hopbench::simulation::report::{Disrupted, DisruptedWay};
use hopbench::time::SimTime;

use crate::wire::mavlink::{Piece, next_piece, sample_time_us};

/// Frames under way in one direction: ten seconds of a thousand samples a second. More are lost.
const IN_TRANSIT_MOST: usize = 16 * 1024;

/// The wire between a bench and its flight controller.
#[derive(Debug)]
pub(crate) struct Disruption {
    to_fc: Way,
    from_fc: Way,
    fc: FcEffect,
    /// Nothing is broken and nothing is under way.
    clear: bool,
    /// Something has been broken.
    acted: bool,
}

/// A HIL_SENSOR, or the answer to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sample {
    /// Its time on the wire (us).
    pub(crate) time_us: u64,
    /// It will not arrive, or not whole.
    pub(crate) lost: bool,
}

/// One direction.
#[derive(Debug)]
struct Way {
    effect: Direction,
    /// Nothing passes.
    dark: bool,
    /// For samples and answers, and for all else.
    streams: [Stream; 2],
    /// By when they are due (us) and in which order they came.
    in_transit: BTreeMap<(u64, u64), InTransit>,
    came: u64,
    /// The beginning of a frame whose end has not come.
    tail: Vec<u8>,
    counts: DisruptedWay,
}

#[derive(Debug)]
struct InTransit {
    /// Empty: lost on the way.
    frame: Vec<u8>,
    sample: Option<Sample>,
}

impl Disruption {
    /// A sound wire.
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            to_fc: Way::new(seed, "fault.wire_to_fc"),
            from_fc: Way::new(seed, "fault.wire_from_fc"),
            fc: FcEffect::default(),
            clear: true,
            acted: false,
        }
    }

    /// What is broken from now on. True when the flight controller is to be told to boot anew: once at a
    /// reboot, and when its power is back.
    #[must_use]
    pub(crate) fn set(&mut self, effect: &WireEffect) -> bool {
        self.acted |= *effect != WireEffect::default();
        for (way, effect_of_way) in [(&mut self.to_fc, effect.to_fc), (&mut self.from_fc, effect.from_fc)] {
            way.effect = effect_of_way;
            way.dark = effect_of_way.disconnected || effect.fc.brown_out;
        }
        let before = std::mem::replace(&mut self.fc, effect.fc);
        self.update_clear();
        (effect.fc.reboots && !before.reboots) || (before.brown_out && !effect.fc.brown_out)
    }

    /// Whether bytes pass as they are: there is nothing to ask of this wire.
    pub(crate) fn is_clear(&self) -> bool {
        self.clear
    }

    /// Puts `bytes` on the wire to the flight controller and replaces them by what arrives there now. Frames
    /// that arrive, and the newest sample among those that did or would have, had they not been lost.
    pub(crate) fn carry_to_fc(&mut self, bytes: &mut Vec<u8>, now: SimTime) -> (u64, Option<Sample>) {
        self.to_fc.put(bytes, now, |_| {});
        let delivered = self.to_fc.deliver(bytes, now);
        self.update_clear();
        delivered
    }

    /// Puts `bytes` on the wire from the flight controller and replaces them by what arrives now. `answer`
    /// hears of each answer as it is put on the wire.
    pub(crate) fn carry_from_fc(&mut self, bytes: &mut Vec<u8>, now: SimTime, answer: impl FnMut(Sample)) {
        self.from_fc.put(bytes, now, answer);
        self.from_fc.deliver(bytes, now);
        self.update_clear();
    }

    /// The other end has gone or come: the rest of a frame will not follow.
    pub(crate) fn forget_tails(&mut self) {
        self.from_fc.tail.clear();
        self.update_clear();
    }

    /// What became of frames, once anything was broken.
    pub(crate) fn report(&self) -> Option<Disrupted> {
        self.acted.then_some(Disrupted { to_fc: self.to_fc.counts, from_fc: self.from_fc.counts })
    }

    fn update_clear(&mut self) {
        self.clear = self.to_fc.is_clear() && self.from_fc.is_clear();
    }
}

impl Way {
    fn new(seed: u64, name: &str) -> Self {
        Self {
            effect: Direction::default(),
            dark: false,
            streams: [noise::stream(seed, name), noise::stream(seed, &format!("{name}.other"))],
            in_transit: BTreeMap::new(),
            came: 0,
            tail: Vec::new(),
            counts: DisruptedWay::default(),
        }
    }

    fn is_sound(&self) -> bool {
        !self.dark && self.effect == Direction::default()
    }

    fn is_clear(&self) -> bool {
        self.is_sound() && self.in_transit.is_empty() && self.tail.is_empty()
    }

    /// Leaves in `bytes` what belongs to no frame and passes at once.
    fn put(&mut self, bytes: &mut Vec<u8>, now: SimTime, mut entered: impl FnMut(Sample)) {
        self.tail.append(bytes);
        let stream = std::mem::take(&mut self.tail);
        let mut rest = &stream[..];
        while let Some(piece) = next_piece(rest) {
            let (Piece::Frame(length) | Piece::Noise(length)) = piece;
            let (piece_bytes, behind) = rest.split_at(length);
            rest = behind;
            match piece {
                Piece::Frame(_) => self.enter(piece_bytes, now.us()).into_iter().for_each(&mut entered),
                Piece::Noise(_) if self.dark => {}
                Piece::Noise(_) => bytes.extend_from_slice(piece_bytes),
            }
        }
        self.tail = rest.to_vec();
    }

    /// Draws what becomes of a frame.
    fn enter(&mut self, frame: &[u8], now_us: u64) -> Option<Sample> {
        let time_us = sample_time_us(frame);
        let stream = &mut self.streams[usize::from(time_us.is_none())];
        // On (0, 1]: a share of 0 never happens, a share of 1 always.
        let [drop, duplicate, corrupt, place, first, second] = [(); 6].map(|()| stream.uniform());
        let effect = self.effect;

        let mut frame = frame.to_vec();
        let mut copies = 1;
        let mut lost = false;
        if self.dark || drop <= effect.drop_share || self.in_transit.len() >= IN_TRANSIT_MOST {
            self.counts.dropped += 1;
            lost = true;
            frame.clear();
        } else {
            if corrupt <= effect.corrupt_share {
                self.counts.corrupted += 1;
                lost = true;
                let bit = ((place * (8 * frame.len()) as f64) as usize).min(8 * frame.len() - 1);
                frame[bit / 8] ^= 1 << (bit % 8);
            }
            if duplicate <= effect.duplicate_share {
                self.counts.duplicated += 1;
                copies = 2;
            }
        }
        let sample = time_us.map(|time_us| Sample { time_us, lost });
        if self.in_transit.len() < IN_TRANSIT_MOST {
            for jitter in [first, second].into_iter().take(copies) {
                let due_us = self.due_us(now_us, jitter);
                self.counts.delayed += u64::from(due_us > now_us && !frame.is_empty());
                self.in_transit.insert((due_us, self.came), InTransit { frame: frame.clone(), sample });
                self.came += 1;
            }
        }
        sample
    }

    /// When a frame that enters now arrives; without jitter none overtakes another.
    fn due_us(&self, now_us: u64, jitter: f64) -> u64 {
        let late_us = SimTime::from_s(self.effect.delay_s + jitter * self.effect.jitter_s).us();
        let due_us = now_us.saturating_add(late_us);
        match self.in_transit.last_key_value() {
            Some(((last_us, _), _)) if self.effect.jitter_s == 0.0 => due_us.max(*last_us),
            _ => due_us,
        }
    }

    /// Appends what is due to `bytes`.
    fn deliver(&mut self, bytes: &mut Vec<u8>, now: SimTime) -> (u64, Option<Sample>) {
        let (mut frames, mut newest) = (0, None::<Sample>);
        while let Some(first) = self.in_transit.first_entry() {
            if first.key().0 > now.us() {
                break;
            }
            let InTransit { frame, mut sample } = first.remove();
            if self.dark && !frame.is_empty() {
                // What was on the wire when it broke.
                self.counts.dropped += 1;
                sample = sample.map(|sample| Sample { lost: true, ..sample });
            } else if !frame.is_empty() {
                frames += 1;
                bytes.extend_from_slice(&frame);
            }
            if let Some(sample) = sample
                && newest.is_none_or(|newest| newest.time_us < sample.time_us)
            {
                newest = Some(sample);
            }
        }
        if self.is_sound() && self.in_transit.is_empty() {
            bytes.append(&mut self.tail);
        }
        (frames, newest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mavlink::{ControlsFrame, Decoder, Encoder, FromFc, actuator_controls};

    fn broken(from_fc: Direction) -> WireEffect {
        WireEffect { from_fc, ..WireEffect::default() }
    }

    fn at(us: u64) -> SimTime {
        SimTime::from_us(us)
    }

    /// Answers to samples every 4 ms, and where each frame ends.
    fn answers(count: u64) -> (Vec<u8>, Vec<usize>) {
        let mut encoder = Encoder::new(1, 1);
        let (mut bytes, mut ends) = (Vec::new(), Vec::new());
        for i in 1..=count {
            let frame = ControlsFrame { time_us: 4000 * i, flags: 1, controls: [0.25; 16], mode: 129 };
            encoder.encode(&actuator_controls(&frame), &mut bytes);
            ends.push(bytes.len());
        }
        (bytes, ends)
    }

    fn times(bytes: &[u8]) -> Vec<u64> {
        let mut decoder = Decoder::default();
        decoder.push(bytes);
        std::iter::from_fn(|| decoder.next_frame())
            .map(|frame| match frame.from_fc() {
                FromFc::Controls(controls) => controls.time_us,
                other => panic!("{other:?}"),
            })
            .collect()
    }

    #[test]
    fn bytes_cut_anywhere_suffer_the_same() {
        let (bytes, _) = answers(200);
        let effect =
            Direction { drop_share: 0.2, duplicate_share: 0.2, corrupt_share: 0.2, ..Direction::default() };
        let through = |size: usize| {
            let mut wire = Disruption::new(7);
            assert!(!wire.set(&broken(effect)));
            let mut out = Vec::new();
            for part in bytes.chunks(size) {
                let mut part = part.to_vec();
                wire.carry_from_fc(&mut part, SimTime::ZERO, |_| {});
                out.extend(part);
            }
            (out, wire.report())
        };
        let whole = through(bytes.len());
        assert_ne!(whole.0, bytes);
        for size in [1, 7, 93, 280] {
            assert!(through(size) == whole, "pieces of {size}");
        }
    }

    /// What is no frame passes; a sound wire has nothing more to say once all has arrived.
    #[test]
    fn noise_passes_and_the_end_of_a_fault_lets_go_of_everything() {
        let (bytes, ends) = answers(2);
        let mut wire = Disruption::new(1);
        assert!(wire.is_clear() && wire.report().is_none());
        let _ = wire.set(&broken(Direction { delay_s: 0.01, ..Direction::default() }));
        let mut given = [&[1, 2, 3], &bytes[..ends[0] + 20]].concat();
        wire.carry_from_fc(&mut given, at(0), |_| {});
        assert_eq!(given, [1, 2, 3]);
        let _ = wire.set(&WireEffect::default());
        assert!(!wire.is_clear());
        let mut late = Vec::new();
        wire.carry_from_fc(&mut late, at(10_000), |_| {});
        assert_eq!(late, bytes[..ends[0] + 20]);
        assert!(wire.is_clear());
    }

    #[test]
    fn without_jitter_none_overtakes_another_even_when_the_delay_shrinks() {
        let (bytes, ends) = answers(2);
        let mut wire = Disruption::new(1);
        let _ = wire.set(&broken(Direction { delay_s: 0.02, ..Direction::default() }));
        let mut first = bytes[..ends[0]].to_vec();
        wire.carry_from_fc(&mut first, at(4000), |_| {});
        let _ = wire.set(&broken(Direction { delay_s: 0.001, ..Direction::default() }));
        let mut second = bytes[ends[0]..].to_vec();
        wire.carry_from_fc(&mut second, at(8000), |_| {});
        assert!(first.is_empty() && second.is_empty());
        let mut out = Vec::new();
        wire.carry_from_fc(&mut out, at(23_999), |_| {});
        assert!(out.is_empty());
        wire.carry_from_fc(&mut out, at(24_000), |_| {});
        assert_eq!(times(&out), [4000, 8000]);
    }

    #[test]
    fn a_wire_that_breaks_loses_what_is_on_it() {
        let (bytes, _) = answers(5);
        let mut wire = Disruption::new(1);
        let _ = wire.set(&broken(Direction { delay_s: 0.02, ..Direction::default() }));
        let mut heard = 0;
        wire.carry_from_fc(&mut bytes.clone(), at(0), |sample| heard += u64::from(!sample.lost));
        assert_eq!(heard, 5);
        let _ = wire.set(&broken(Direction { disconnected: true, ..Direction::default() }));
        let mut out = [&bytes[..], &[9, 9]].concat();
        wire.carry_from_fc(&mut out, at(30_000), |sample| assert!(sample.lost));
        assert!(out.is_empty());
        assert_eq!(wire.report().unwrap().from_fc.dropped, 10);
    }

    #[test]
    fn what_is_under_way_is_bounded() {
        let (bytes, _) = answers(1000);
        let mut wire = Disruption::new(1);
        let forever = Direction { delay_s: 1e9, duplicate_share: 1.0, ..Direction::default() };
        let _ = wire.set(&broken(forever));
        (0..20).for_each(|_| wire.carry_from_fc(&mut bytes.clone(), at(0), |_| {}));
        assert!(wire.from_fc.in_transit.len() <= IN_TRANSIT_MOST + 1);
        assert!(wire.report().unwrap().from_fc.dropped > 0);
    }

    #[test]
    fn a_controller_boots_once_at_a_reboot_and_when_its_power_is_back() {
        let mut wire = Disruption::new(1);
        let fc =
            |reboots, brown_out| WireEffect { fc: FcEffect { reboots, brown_out }, ..WireEffect::default() };
        let told: Vec<bool> =
            [(true, false), (true, false), (false, false), (false, true), (false, true), (false, false)]
                .map(|(reboots, brown_out)| wire.set(&fc(reboots, brown_out)))
                .to_vec();
        assert_eq!(told, [true, false, false, false, false, true]);
    }
}

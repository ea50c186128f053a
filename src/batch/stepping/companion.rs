//! Companions: the motions of instances at half the step in double precision, whose differences are the errors.
//!
//! A companion starts in the state of its instance and gets the same inputs. Errors at steps h and h / 2 have the ratio 1 : `2^-p`
//! for a method of order p, to leading order, however the errors of the steps add up `[HNW93 sec. II.4]`: the error of the
//! instance is the difference over `1 - 2^-p`. At kinks of the forces any method has order 2. The divisor is therefore the
//! geometric mean of the divisor of order p, counted twice, and the divisor of order 2. As it is near 1, the difference estimates errors
//! beyond the leading order too. In single precision rounding is part of it.

use std::any::Any;

use super::parameters::{Parameters, StepSettings};
use super::track::{Stage, Track, divisor};
use crate::batch::monitoring::step_quality::{Cause, StepQuality, StepViolation, Violations};
use crate::batch::storage::aligned::Aligned;
use crate::batch::storage::layout::Layout;
use crate::batch::storage::own_numbers::OwnLayout;
use crate::batch::storage::table::Table;
use crate::integrate::Integrator;
use crate::lane::{Isa, Real};
use crate::system::{Compiled, Factors, Flow, JOINTS, State};

/// Steps of an instance between two updates of the scales of its motion.
const SEGMENT: usize = 8;
/// Maximum number of instances of which all are followed; of more instances this number per chunk is, in turns.
const FEW: usize = f64::BLOCK;
/// Time for which instances are followed where they take turns, s.
const WINDOW: f64 = 20.0;
/// Time after which companions begin anew in scenes with contact, s: small differences between contacts grow fast, in motions that
/// steps of any size resolve.
const CONTACT_WINDOW: f64 = 2.0;
/// Share of a chunk's steps that following may take on average.
const SHARE: f64 = 0.01;
/// Cost of following a group of instances, in motions of one instance in double and in single precision.
const COST: [f64; 2] = [2.0 * FEW as f64, 4.0 * FEW as f64];
/// Cost of a call, in steps.
const CALL: f64 = 3.0;

/// Instances that companions follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Follow {
    /// All; the companions are part of the saved state.
    Saved,
    /// All instances.
    All,
    /// A few of each chunk, in turns.
    Turns,
}

impl Follow {
    /// Instances followed in a batch in which errors are estimated, or not, or by default.
    pub fn of(error_estimate: Option<bool>, instances: usize) -> Option<Self> {
        match error_estimate {
            Some(true) => Some(Self::Saved),
            Some(false) => None,
            None if instances <= FEW => Some(Self::All),
            None => Some(Self::Turns),
        }
    }
}

/// All that the companions of a batch share.
#[derive(Clone)]
pub struct CompanionScene {
    follow: Follow,
    /// Rows of the companions.
    table: Table,
    /// Parameters in double precision, where the instances are in single.
    parameters: Option<Box<Parameters<f64>>>,
    /// Rows of the loads: of the instance, and of the companion.
    loads: Vec<[usize; 2]>,
    /// Rows of the integrator's memory besides the state: of the instance, and of the companion.
    memory: Vec<[usize; 2]>,
    isa: Isa,
    /// Cost of following a group, in motions of one instance.
    cost: f64,
    /// Time after which companions begin anew, if they do, s.
    window: Option<f64>,
    /// False in scenes with contact, where velocities jump.
    smooth: bool,
}

/// Companions of a batch.
#[derive(Clone)]
pub struct Companions {
    /// All that they share.
    pub scene: CompanionScene,
    /// Companions of each chunk.
    pub chunks: Vec<ChunkCompanions>,
}

/// The instances of a chunk.
pub struct Leaders<'a, T> {
    /// Parameters of their scene.
    pub scene: &'a Parameters<T>,
    /// Access to single instances.
    pub table: &'a Table,
    /// The blocks.
    pub rows: &'a [T],
    /// Numbers that instances have of their own.
    pub own: Option<(&'a OwnLayout, &'a [T])>,
    /// Number of instances.
    pub count: usize,
}

/// Companions of instances of a chunk: the first one follows instance `first`, and so on.
#[derive(Clone)]
pub struct ChunkCompanions {
    first: usize,
    /// Number of companions; 0 while none is followed.
    count: usize,
    rows: Aligned<f64>,
    /// Numbers of their own.
    own: Vec<f64>,
    tracks: Vec<Track>,
    /// Time for which they still follow, where instances take turns, s.
    left: f64,
    /// Motion of the chunk that following has earned, or owes: number of instances times s.
    credit: f64,
}

impl CompanionScene {
    /// Companions of the instances of a compiled scene.
    pub fn new<T: Real>(
        follow: Follow,
        compiled: &Compiled,
        integrator: &Integrator,
        isa: Isa,
        layout: &Layout,
    ) -> Self {
        let own = Layout::new::<f64>([layout.joints, layout.thrusters, layout.fins], integrator);
        let pairs = |there: &[[usize; 2]], here: &[[usize; 2]]| {
            let both = there.iter().zip(here);
            both.flat_map(|(&[from, count], &[to, _])| (0..count).map(move |k| [from + k, to + k])).collect()
        };
        Self {
            follow,
            loads: pairs(&layout.load_rows(), &own.load_rows()),
            memory: pairs(&layout.memory_rows(), &own.memory_rows()),
            parameters: T::SINGLE.then(|| Box::new(Parameters::new(compiled, integrator))),
            table: Table { layout: own, links: Vec::new() },
            isa,
            cost: COST[usize::from(T::SINGLE)],
            window: (follow != Follow::Saved && compiled.system.contact.is_some()).then_some(CONTACT_WINDOW),
            smooth: compiled.system.contact.is_none(),
        }
    }

    /// True where all instances are followed.
    pub fn follows_all(&self) -> bool {
        self.follow != Follow::Turns
    }

    /// Numbers of a companion that are saved with its instance.
    pub fn saved(&self) -> usize {
        let Layout { rows, joints, .. } = self.table.layout;
        if self.follow == Follow::Saved { rows + joints + 21 } else { 0 }
    }

    fn parameters<'a, T: Real>(&'a self, leaders: &Leaders<'a, T>) -> Option<&'a Parameters<f64>> {
        self.parameters.as_deref().or_else(|| (leaders.scene as &dyn Any).downcast_ref())
    }
}

impl ChunkCompanions {
    /// Companions of a chunk of `count` instances, number `chunk` of `chunks`, in a valid state; none where they do not fit into
    /// memory. `own` is the layout of numbers that instances have of their own.
    pub fn new(
        scene: &CompanionScene,
        [chunk, chunks, count]: [usize; 3],
        compiled: &Compiled,
        (state, flow): (&State, &Flow),
        own: Option<&OwnLayout>,
    ) -> Option<Self> {
        let most = if scene.follows_all() { count } else { FEW.min(count) };
        let columns = most.next_multiple_of(f64::BLOCK);
        let mut rows = Aligned::filled(columns * scene.table.layout.rows, 0.0).ok()?;
        let mut own_rows = vec![0.0; own.map_or(0, |layout| layout.width * columns)];
        for column in 0..columns {
            scene.table.set_state(&mut rows, column, state);
            scene.table.set_flow(&mut rows, column, flow);
            scene.table.set_factors(&mut rows, column, &Factors::ONE);
            scene.table.set_fins(&mut rows, column, &compiled.system.terms.deflections());
            if let Some(layout) = own {
                layout.set(&mut own_rows, column, compiled);
            }
        }
        let tracks = vec![Track::new(Stage::Fresh, state.clone()); most];
        // The first chunk follows from the start on; the others in turns, as they have earned it.
        let credit = -(chunk as f64) / chunks as f64 * scene.cost * WINDOW;
        let count = if scene.follows_all() { most } else { 0 };
        Some(Self { first: 0, count, rows, own: own_rows, tracks, left: 0.0, credit })
    }

    /// Column of the companion of instance `i`.
    fn column(&self, i: usize) -> Option<usize> {
        i.checked_sub(self.first).filter(|column| *column < self.count)
    }

    /// The companion of instance `i` begins in this state with the next step.
    pub fn set_state(&mut self, scene: &CompanionScene, i: usize, state: &State) {
        let Some(column) = self.column(i) else { return };
        scene.table.set_state(&mut self.rows, column, state);
        self.tracks[column].stage = Stage::Given;
        if self.credit > -2.0 * scene.cost * WINDOW {
            self.left = WINDOW;
        }
    }

    /// Sets the parts of the companion of instance `i` in which two states of the instance differ; it begins anew where it keeps no
    /// error in another part.
    pub fn change_state(&mut self, scene: &CompanionScene, i: usize, from: &State, to: &State) {
        let Some(column) = self.column(i) else { return };
        let mut state = scene.table.state(&self.rows, column);
        let track = &mut self.tracks[column];
        track.change(&mut state, from, to);
        if track.stage != Stage::Follows || state == *to {
            self.set_state(scene, i, to);
        } else {
            scene.table.set_state(&mut self.rows, column, &state);
        }
    }

    /// True where a companion follows instance `i`.
    pub fn follows(&self, i: usize) -> bool {
        self.column(i).is_some()
    }

    /// The companion of instance `i` begins with these attitude coordinates.
    pub fn set_attitude(&mut self, scene: &CompanionScene, i: usize, attitude: &[f64; 4]) {
        if let Some(column) = self.column(i) {
            scene.table.set_attitude(&mut self.rows, column, attitude);
        }
    }

    /// Track of the companion of instance `i`, if there is one.
    pub fn track(&mut self, i: usize) -> Option<&mut Track> {
        self.column(i).map(|column| &mut self.tracks[column])
    }

    /// Changes the velocities of the companion of instance `i` as the velocities of the instance change.
    pub fn change_velocities(&mut self, scene: &CompanionScene, i: usize, from: &State, to: &State) {
        let Some(column) = self.column(i) else { return };
        let mut state = scene.table.state(&self.rows, column);
        state.twist += to.twist - from.twist;
        for k in 0..JOINTS {
            state.qd[k] += to.qd[k] - from.qd[k];
        }
        scene.table.set_velocities(&mut self.rows, column, &state);
    }

    /// State of the companion of instance `i`, if it follows, and its relative error.
    pub fn of(&self, scene: &CompanionScene, i: usize) -> Option<(State, f64)> {
        let column = self.column(i).filter(|column| self.tracks[*column].stage == Stage::Follows)?;
        Some((scene.table.state(&self.rows, column), self.tracks[column].relative))
    }

    /// Steps the companions at half the step, before the steps of their instances from the present states under the present
    /// loads. Returns false where no instance is followed.
    pub fn step<T: Real>(
        &mut self,
        scene: &CompanionScene,
        leaders: &Leaders<'_, T>,
        scaled: [bool; 2],
        settings: &StepSettings,
    ) -> bool {
        let &StepSettings { integrator, h, substeps, before, total, .. } = settings;
        if !scene.follows_all() {
            self.take_turns(scene.cost, leaders.count, h, substeps as f64);
        }
        let Some(parameters) = scene.parameters(leaders).filter(|_| self.count > 0) else { return false };
        let leader = (leaders.table, leaders.rows, self.first);
        scene.table.copy(&mut self.rows, 0..self.count, leader, &scene.loads);
        for column in 0..self.count {
            let (i, rows, track) = (self.first + column, &mut self.rows, &mut self.tracks[column]);
            let again = track.stage == Stage::Follows && scene.window.is_some_and(|window| track.time >= window);
            if again || track.stage != Stage::Follows {
                let state = leaders.table.state(leaders.rows, i);
                if again || track.stage == Stage::Fresh {
                    scene.table.set_state(rows, column, &state);
                    scene.table.copy(rows, column..column + 1, leader, &scene.memory);
                }
                // The scales of the motion so far stay.
                let scales = if again { track.scales } else { [0.0; 6] };
                *track = Track { scales, ..Track::new(Stage::Follows, state) };
            }
            track.time += h * substeps as f64;
            if let (true, Some((layout, own))) = (std::mem::take(&mut track.own_stale), leaders.own) {
                layout.copy(own, i, &mut self.own, column);
            }
        }
        // Half the maximum rotation of a sub-interval, and a tighter tolerance: otherwise both motions would take the same
        // sub-intervals. The minimum tolerance by rounding must differ as well.
        let order = integrator.order() as i32;
        let integrator = integrator.at_ratio(0.5, 0.5_f64.powi(order), T::EPSILON).resolving_bounces();
        let (mut done, end) = (before, before + substeps);
        while done < end {
            // On the clock of the call: its division into portions does not show.
            let next = end.min((done / SEGMENT + 1) * SEGMENT);
            let (before, substeps) = (2 * done, 2 * (next - done));
            let settings = StepSettings { integrator, h: 0.5 * h, before, substeps, ..*settings };
            done = next;
            let own = leaders.own.map(|(layout, _)| layout.columns(&self.own));
            let (layout, count) = (&scene.table.layout, self.count);
            parameters.steps(layout, own, scaled, &settings, count, &mut self.rows).run(scene.isa);
            // After the last step of the call the comparison updates the scales.
            let widened = if next % SEGMENT == 0 && next < total { count } else { 0 };
            for column in 0..widened {
                self.tracks[column].widen(&scene.table.state(&self.rows, column), layout.joints);
            }
        }
        true
    }

    /// Ends the turn of instances that have been followed for long enough, and begins the turn of the next ones once `count`
    /// instances have earned it; before a call of some steps.
    fn take_turns(&mut self, cost: f64, count: usize, h: f64, steps: f64) {
        if self.count > 0 && self.left <= 0.0 {
            self.first = (self.first + self.count) % count;
            self.count = 0;
        }
        if self.count == 0 && self.credit >= 0.0 {
            self.count = self.tracks.len().min(count - self.first);
            self.left = WINDOW;
            self.tracks.iter_mut().for_each(|track| track.stage = Stage::Fresh);
        }
        self.credit += SHARE * count as f64 * h * steps;
        if self.count > 0 {
            self.credit -= cost * h * (steps + CALL);
            self.left -= h * steps;
        }
    }

    /// Compares the instances with their companions after the same steps; adds errors beyond the limit to violations.
    pub fn compare<T: Real>(
        &mut self,
        scene: &CompanionScene,
        table: &Table,
        rows: &[T],
        settings: &StepSettings,
        found: &mut Violations,
    ) {
        let divisor = divisor(settings.integrator.order());
        for column in 0..self.count {
            let (i, track) = (self.first + column, &mut self.tracks[column]);
            let (state, other) = (table.state(rows, i), scene.table.state(&self.rows, column));
            track.compare(&state, &other, table.layout.joints, divisor, scene.smooth);
            let Some(limits) = settings.limits else { continue };
            if track.beyond(limits.accumulated) && table.violation(rows, i, limits, settings.h).is_none() {
                let quality = StepQuality { accumulated: track.relative, ..table.step_quality(rows, i, settings.h) };
                found.add(Cause::Accumulated, StepViolation { instance: i, count: 1, time: state.time, quality });
            }
        }
    }

    /// All numbers of the companion of instance `i`; their count is [`CompanionScene::saved`].
    pub fn save(&self, scene: &CompanionScene, i: usize) -> Vec<f64> {
        let track = &self.tracks[i];
        let stage = if track.stage == Stage::Follows { 1.0 } else { 0.0 };
        let joints = scene.table.layout.joints;
        let start = track.start.position.iter().chain(track.start.rotation.iter()).chain(&track.start.q[..joints]);
        let rows = scene.table.column(&self.rows, i);
        rows.into_iter().chain(start.copied()).chain(track.scales).chain([track.relative, stage, track.time]).collect()
    }

    /// Sets these numbers.
    pub fn load(&mut self, scene: &CompanionScene, i: usize, numbers: &[f64]) {
        let (rows, rest) = numbers.split_at(scene.table.layout.rows);
        scene.table.set_column(&mut self.rows, i, rows);
        let track = &mut self.tracks[i];
        let joints = scene.table.layout.joints;
        track.start.position.copy_from_slice(&rest[..3]);
        track.start.rotation.copy_from_slice(&rest[3..12]);
        track.start.q[..joints].copy_from_slice(&rest[12..12 + joints]);
        track.scales.copy_from_slice(&rest[12 + joints..18 + joints]);
        track.relative = rest[18 + joints];
        track.own_stale = true;
        track.stage = if rest[19 + joints] == 0.0 { Stage::Fresh } else { Stage::Follows };
        track.time = rest[20 + joints];
    }

    /// Memory of the companions, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.rows[..]) + size_of_val(&self.own[..]) + size_of_val(&self.tracks[..])
    }
}

//! Evidence of the last minute of motion, which the checks read.

use nalgebra::Complex;

use crate::curve::{Bend, Bends, Curve};
use crate::fit::{self, Equation, quantile};
use crate::grid::{Channel, Grid};
use crate::lag::{self, Lag, Numbers, Vectors};

/// Cells of a row: 0.3 s.
const ROW_CELLS: i64 = 3;
/// Fewest rows in motion that show anything.
const ROWS_MIN: usize = 20;
/// Longest lag that is looked for, s.
pub(crate) const LAG_MAX_S: f64 = 8.0;
/// Largest angle of a steered wheel, rad.
const STEERED_MAX_RAD: f64 = 1.4;

/// Motion over 0.3 s.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    /// The LiDAR's velocity in its own frame, m/s.
    pub u: Complex<f64>,
    /// Its yaw rate, rad/s.
    pub w: f64,
    /// Speed as sent, m/s.
    pub v: f64,
    /// Steering angle as sent, rad.
    pub d: f64,
}

/// First equation: speed and mount without the steering.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mount {
    /// The LiDAR's metres for each reported one.
    pub scale: f64,
    pub yaw_rad: f64,
    pub x_m: f64,
    pub y_m: f64,
    /// Median residual with the speed of the fixed axle, and with that of the steered wheel, m/s.
    pub residual_axle: f64,
    pub residual_wheel: f64,
    /// Share of the speed that the better of both explains, 0 to 1.
    pub explained: f64,
    /// Correlation of the speeds at the mount.
    pub correlation: f64,
    /// Share of the driving in which the LiDAR moves against the speed's sign.
    pub flipped: f64,
    /// Rows behind it.
    pub straight_rows: usize,
    /// Share of the LiDAR's motion in which the speed is 0.
    pub blind: f64,
    pub blind_rows: usize,
    /// Largest speed, m/s, at which it is.
    pub blind_below_mps: f64,
}

/// Second equation: the steering.
#[derive(Debug, Clone)]
pub(crate) struct Steering {
    pub curve: Curve,
    /// Share of the curve that the angle explains.
    pub explained: f64,
    /// The slope over its own deviation.
    pub sigmas: f64,
    /// `true` if the vehicle turned to both sides.
    pub both_sides: bool,
    /// The best gear with the described wheelbase, and the best wheelbase without a gear.
    pub gear: Option<Curve>,
    pub wheelbase: Option<Curve>,
    /// Half the track over the wheelbase of a linkage whose left wheel is measured, and the share of the
    /// residuals that it leaves.
    pub linkage: Option<(f64, f64)>,
}

/// Evidence of the last minute.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    /// Delays of the wheels behind the LiDAR by speed, and by steering.
    pub by_speed: Lag,
    pub by_steering: Lag,
    /// The lag that rows were made with, s.
    pub used_lag_s: f64,
    /// Ninetieth percentile of the LiDAR's speed, m/s, and its spread.
    pub fast_mps: f64,
    pub speed_spread_mps: f64,
    /// Its largest yaw rate, one row in twenty left out, rad/s.
    pub turn_radps: f64,
    /// Largest size, mean and spread of the speed sent, m/s.
    pub sent_largest_mps: f64,
    pub sent_mean_mps: f64,
    pub sent_spread_mps: f64,
    /// Share of the speeds sent that are negative.
    pub sent_negative: f64,
    /// Width of the angles sent and of the curves driven (times the wheelbase).
    pub angle_width_rad: f64,
    pub angle_rad: f64,
    pub curve_width: f64,
    pub mount: Option<Mount>,
    pub steering: Option<Steering>,
}

/// Series of the complete cells.
struct Series {
    u: Vectors,
    speed: Vectors,
    turn: Vectors,
    v: Numbers,
    d: Numbers,
}

impl Series {
    fn of(grid: &Grid) -> Self {
        let cells = grid.range();
        let value = |channel, cell| {
            grid.value(channel, cell)
                .map_or(f32::NAN, |value| value as f32)
        };
        let of = |channel| -> Numbers { cells.clone().map(|cell| value(channel, cell)).collect() };
        let (ahead, left, turn) = (of(Channel::Ahead), of(Channel::Left), of(Channel::Turn));
        let size = |(x, y): (&f32, &f32)| (x.hypot(*y), 0.0);
        Self {
            speed: ahead.iter().zip(&left).map(size).collect(),
            u: ahead.into_iter().zip(left).collect(),
            turn: turn.into_iter().map(|w| (w, 0.0)).collect(),
            v: of(Channel::Speed),
            d: of(Channel::Steering),
        }
    }

    /// Each pair of speed and angle as one number.
    fn wheels(&self, number: impl Fn(f32, f32) -> f32) -> Numbers {
        self.v
            .iter()
            .zip(&self.d)
            .map(|(v, d)| number(*v, *d))
            .collect()
    }
}

/// Angles about the middle of those sent, where the sensor's zero is far away.
fn middle_of(angles: &Numbers) -> (f32, bool) {
    let mut finite: Vec<f64> = angles
        .iter()
        .filter(|d| d.is_finite())
        .map(|d| f64::from(*d))
        .collect();
    let middle = fit::median(&mut finite);
    let mut around: Vec<f64> = finite.iter().map(|d| (d - middle).abs()).collect();
    let is_far = middle.abs() > 1.2 && quantile(&mut around, 0.95) < 1.0;
    let middle = if is_far { middle } else { 0.0 };
    let mut around: Vec<f64> = finite.iter().map(|d| (d - middle).abs()).collect();
    (middle as f32, quantile(&mut around, 0.98) < 1.7)
}

impl Motion {
    /// Returns the evidence of the cells for a vehicle with this wheelbase, m; `None` while too few are complete.
    pub fn of(grid: &Grid, wheelbase_m: f64) -> Option<Self> {
        let series = Series::of(grid);
        let (middle, are_radians) = middle_of(&series.d);
        let lags = Lags::of(&series, middle, are_radians);
        let rows = rows(grid, lags.used_s);
        if rows.len() < ROWS_MIN {
            return None;
        }
        let of = |value: fn(&Row) -> f64| rows.iter().map(value).collect::<Vec<f64>>();
        let (mut speeds, mut sent) = (of(|row| row.u.norm()), of(|row| row.v));
        let mut angles = of(|row| row.d);
        let (sent_mean_mps, sent_spread_mps) = mean_and_spread(&sent);
        let (_, speed_spread_mps) = mean_and_spread(&speeds);
        let negative = sent.iter().filter(|v| **v < -1e-3).count();
        let mut motion = Self {
            by_speed: lags.by_speed,
            by_steering: lags.by_steering,
            used_lag_s: lags.used_s,
            fast_mps: quantile(&mut speeds, 0.9),
            speed_spread_mps,
            turn_radps: quantile(&mut of(|row| row.w.abs()), 0.95),
            sent_largest_mps: sent.iter().fold(0.0, |most, v| v.abs().max(most)),
            sent_mean_mps,
            sent_spread_mps,
            sent_negative: negative as f64 / rows.len() as f64,
            angle_width_rad: quantile(&mut angles, 0.99) - quantile(&mut angles, 0.01),
            angle_rad: quantile(&mut angles, 0.5),
            curve_width: 0.0,
            mount: None,
            steering: None,
        };
        let fast_sent = quantile(&mut sent.iter().map(|v| v.abs()).collect::<Vec<_>>(), 0.95);
        sent.clear();
        let moving: Vec<Row> = rows
            .iter()
            .copied()
            .filter(|row| row.v.abs() > 0.1 * fast_sent && row.u.norm() < 20.0)
            .collect();
        if moving.len() < ROWS_MIN || motion.fast_mps < 0.05 {
            return Some(motion);
        }
        let cosines = |row: &Row| {
            if are_radians {
                row.d.clamp(-1.6, 1.6).cos()
            } else {
                1.0
            }
        };
        let mount = Mount::of(&rows, &moving, cosines, motion.fast_mps)?;
        let bends = bends(&moving, &mount, wheelbase_m, cosines);
        motion.mount = Some(mount);
        if bends.len() >= ROWS_MIN {
            motion.curve_width = bends.curve_quantile(0.98) - bends.curve_quantile(0.02);
            motion.steering = Steering::of(&bends);
        }
        if let Some(steering) = &motion.steering
            && steering.explained > 0.8
        {
            motion.by_speed =
                Lags::at_mount(&series, &mount, are_radians).unwrap_or(motion.by_speed);
        }
        Some(motion)
    }

    /// True if the speed is that of the steered wheel, false if that of the fixed axle, where it
    /// supports one.
    pub fn is_at_steered_wheel(&self) -> Option<bool> {
        let mount = self.mount?;
        let (axle, wheel) = (mount.residual_axle, mount.residual_wheel);
        if wheel < axle / 1.4 && axle - wheel > 0.004 {
            Some(true)
        } else if axle < wheel / 1.4 && wheel - axle > 0.004 {
            Some(false)
        } else {
            None
        }
    }
}

/// Lags of the wheels behind the LiDAR.
struct Lags {
    by_speed: Lag,
    by_steering: Lag,
    used_s: f64,
}

impl Lags {
    fn of(series: &Series, middle: f32, are_radians: bool) -> Self {
        let angle = |d: f32| (d - middle).clamp(-STEERED_MAX_RAD as f32, STEERED_MAX_RAD as f32);
        let best = |first: &Vectors, second: Numbers| lag::best(first, &second, LAG_MAX_S);
        let better = |a: Lag, b: Lag| if b.correlation > a.correlation { b } else { a };
        let mut by_speed = better(
            best(&series.u, series.v.clone()),
            best(&series.speed, series.v.iter().map(|v| v.abs()).collect()),
        );
        let by_steering = if are_radians {
            by_speed = better(
                by_speed,
                best(&series.u, series.wheels(|v, d| v * angle(d).cos())),
            );
            let by_tan = best(&series.turn, series.wheels(|v, d| v * angle(d).tan()));
            let by_sine = best(&series.turn, series.wheels(|v, d| v * angle(d).sin()));
            let unsigned = best(&series.turn, series.wheels(|v, d| v.abs() * angle(d).tan()));
            better(by_tan, better(by_sine, unsigned))
        } else {
            best(&series.turn, series.wheels(|v, d| v * (d - middle)))
        };
        let steering_leads = by_steering.correlation > 0.85
            && (by_steering.sigma_s < by_speed.sigma_s || by_speed.correlation < 0.7);
        let used = if steering_leads {
            by_steering
        } else {
            by_speed
        };
        Self {
            by_speed,
            by_steering,
            used_s: if used.correlation > 0.85 {
                used.late_s
            } else {
                0.0
            },
        }
    }

    /// Lag of the speed behind the vehicle's own, with the effect of the mount's lever removed.
    fn at_mount(series: &Series, mount: &Mount, are_radians: bool) -> Option<Lag> {
        let lever = (mount.x_m.hypot(mount.y_m) < 20.0).then(|| mount.lever())?;
        let base = |((x, y), (w, _)): (&(f32, f32), &(f32, f32))| {
            let at_base = Complex::new(f64::from(*x), f64::from(*y)) - lever * f64::from(*w);
            (at_base.norm() as f32, 0.0)
        };
        let speeds: Vectors = series.u.iter().zip(&series.turn).map(base).collect();
        let is_wheels = are_radians && mount.residual_wheel < mount.residual_axle;
        let sent = series.wheels(|v, d| {
            if is_wheels {
                (v * d.clamp(-1.3, 1.3).cos()).abs()
            } else {
                v.abs()
            }
        });
        Some(lag::best(&speeds, &sent, 1.5))
    }
}

/// Rows of the cells, wheels shifted by the lag.
fn rows(grid: &Grid, lag_s: f64) -> Vec<Row> {
    let cells = grid.range();
    let shift = lag_s / crate::grid::CELL_S;
    let (whole, part) = (shift.floor() as i64, shift - shift.floor());
    let wheels = |channel, cell: i64| {
        let (first, second) = (
            grid.value(channel, cell + whole)?,
            grid.value(channel, cell + whole + 1),
        );
        if part < 1e-3 {
            return Some(first);
        }
        Some(first + part * (second? - first))
    };
    let mean = |start: i64, value: &dyn Fn(i64) -> Option<f64>| {
        let mut sum = 0.0;
        for cell in start..start + ROW_CELLS {
            sum += value(cell)?;
        }
        Some(sum / ROW_CELLS as f64)
    };
    let row = |start: i64| {
        Some(Row {
            u: Complex::new(
                mean(start, &|cell| grid.value(Channel::Ahead, cell))?,
                mean(start, &|cell| grid.value(Channel::Left, cell))?,
            ),
            w: mean(start, &|cell| grid.value(Channel::Turn, cell))?,
            v: mean(start, &|cell| wheels(Channel::Speed, cell))?,
            d: mean(start, &|cell| wheels(Channel::Steering, cell))?,
        })
    };
    let starts = (0..).map(|k| cells.start + k * ROW_CELLS);
    let starts = starts.take_while(|start| start + ROW_CELLS <= cells.end);
    starts.filter_map(row).collect()
}

impl Mount {
    fn of(
        rows: &[Row],
        moving: &[Row],
        cosine: impl Fn(&Row) -> f64,
        fast_mps: f64,
    ) -> Option<Self> {
        let fit = |x: &dyn Fn(&Row) -> f64| {
            let equation = |row: &Row| Equation {
                a: Complex::from(x(row)),
                b: Complex::from(row.w),
                y: row.u,
                weight: 1.0,
            };
            fit::complex(&moving.iter().map(equation).collect::<Vec<_>>())
        };
        let of_wheel = |row: &Row| row.v * cosine(row);
        // Without any turn the lever stays unknown, and 0 will do.
        let axle = fit(&|row| row.v)?;
        let wheel = fit(&of_wheel)?;
        let is_wheel = wheel.median < axle.median / 1.4 && axle.median - wheel.median > 0.004;
        let best = if is_wheel { wheel } else { axle };
        let x = |row: &Row| if is_wheel { of_wheel(row) } else { row.v };
        let (a, b) = (best.first, best.second);
        let scale = a.norm();
        if !(scale > 0.0 && scale.is_finite()) {
            return None;
        }
        let place = b / a / Complex::new(0.0, 1.0) * scale;
        let mut speeds: Vec<f64> = moving.iter().map(|row| row.u.norm()).collect();
        let middle = quantile(&mut speeds, 0.5).max(1e-9);
        let mut turns: Vec<f64> = rows.iter().map(|row| row.w.abs()).collect();
        let turn_max = 0.5 * quantile(&mut turns, 0.9) + 0.02;
        let is_straight = |row: &&Row| row.u.norm() > 0.2 * fast_mps && row.w.abs() < turn_max;
        let straight: Vec<&Row> = moving.iter().filter(is_straight).collect();
        let against = |row: &&&Row| (row.u / (a * x(row))).arg().abs() > 2.2;
        let flipped = straight.iter().filter(against).count() as f64 / straight.len().max(1) as f64;
        let at_base: Vec<f64> = moving
            .iter()
            .map(|row| (row.u - b * row.w).norm())
            .collect();
        let sent: Vec<f64> = moving.iter().map(|row| x(row).abs()).collect();
        let driven: Vec<&Row> = rows.iter().filter(|row| row.u.norm() > 0.12).collect();
        let is_blind = |row: &&&Row| row.v.abs() < 1e-4;
        let blind_rows = driven.iter().filter(is_blind).count();
        let mut blind: Vec<f64> = driven
            .iter()
            .filter(is_blind)
            .map(|row| row.u.norm())
            .collect();
        Some(Self {
            scale,
            yaw_rad: -a.arg(),
            x_m: place.re,
            y_m: place.im,
            residual_axle: axle.median,
            residual_wheel: wheel.median,
            explained: 1.0 - axle.median.min(wheel.median) / middle,
            correlation: correlation(&at_base, &sent),
            flipped,
            straight_rows: straight.len(),
            blind: blind_rows as f64 / driven.len().max(1) as f64,
            blind_rows,
            blind_below_mps: quantile(&mut blind, 0.9),
        })
    }

    /// Velocity of the LiDAR at a yaw rate of 1 rad/s, in its own frame.
    fn lever(&self) -> Complex<f64> {
        Complex::new(0.0, 1.0)
            * Complex::new(self.x_m, self.y_m)
            * Complex::from_polar(1.0, -self.yaw_rad)
    }
}

fn bends(moving: &[Row], mount: &Mount, wheelbase_m: f64, cosine: impl Fn(&Row) -> f64) -> Bends {
    let is_wheel = mount.residual_wheel < mount.residual_axle / 1.4
        && mount.residual_axle - mount.residual_wheel > 0.004;
    let ahead = Complex::from_polar(1.0, -mount.yaw_rad);
    let bend = |row: &Row| {
        let speed = mount.scale * row.v * if is_wheel { cosine(row) } else { 1.0 };
        // Where the LiDAR goes against the sign of the speed, the curve has no meaning.
        let goes_along = (row.u / (ahead * speed)).arg().abs() < 1.2;
        (speed.abs() > 0.12 && goes_along).then(|| Bend {
            curve: row.w / speed * wheelbase_m,
            angle_rad: row.d,
            weight: speed.abs(),
        })
    };
    Bends::new(moving.iter().filter_map(bend).collect())
}

impl Steering {
    /// Turn driven over the turn by angle and wheelbase, without a gear.
    pub fn turns(&self) -> f64 {
        self.wheelbase
            .map_or_else(|| self.curve.slope(), |line| line.slope())
    }

    fn of(bends: &Bends) -> Option<Self> {
        let curve = bends.free()?;
        let spread = bends.spread().max(1e-9);
        let explained = 1.0 - (curve.rms / spread).powi(2);
        let slope = curve.slope();
        let wheelbase = bends.of_gear(slope.signum());
        let small = (1.0 - explained).max(1e-6);
        Some(Self {
            explained,
            sigmas: (bends.len() as f64).sqrt() * (explained.max(0.0) / small).sqrt(),
            both_sides: bends.curve_quantile(0.95) > 0.06 && bends.curve_quantile(0.05) < -0.06,
            gear: bends.of_wheelbase(slope),
            linkage: wheelbase.as_ref().and_then(|line| bends.linkage(line)),
            wheelbase,
            curve,
        })
    }
}

fn mean_and_spread(values: &[f64]) -> (f64, f64) {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square = values
        .iter()
        .map(|value| (value - mean).powi(2))
        .sum::<f64>();
    (mean, (square / count).sqrt())
}

fn correlation(first: &[f64], second: &[f64]) -> f64 {
    let ((a, sa), (b, sb)) = (mean_and_spread(first), mean_and_spread(second));
    let products = first.iter().zip(second).map(|(x, y)| (x - a) * (y - b));
    let covariance = products.sum::<f64>() / first.len().max(1) as f64;
    if sa * sb > 1e-9 {
        (covariance / (sa * sb)).abs()
    } else {
        0.0
    }
}

//! The causes that are right of each wrong input, and of imperfections that are as large as one.

use fleetcal_checks::Cause;
use fleetcal_robot::simulator::{ImperfectionKind, Strength, WrongInput};

use crate::imperfect::Flaw;

/// The causes that are right of a wrong input, the best one first.
pub const fn expected(input: WrongInput) -> &'static [Cause] {
    use WrongInput as Input;
    match input {
        Input::SteeringSign | Input::MirroredScan => &[Cause::SteeringSign],
        Input::SpeedSign => &[Cause::SpeedSign],
        Input::BothSigns => &[Cause::Backwards],
        Input::Degrees => &[Cause::SteeringDegrees],
        Input::Column => &[Cause::SteeringGear],
        Input::Gear => &[Cause::SteeringGear, Cause::TurnScale],
        Input::QuarterTurn => &[Cause::SteeringZero],
        Input::WrappedRadians => &[Cause::SteeringWrap],
        Input::WrappedDegrees => &[Cause::SteeringWrap, Cause::SteeringDegrees],
        Input::KilometresPerHour
        | Input::MillimetresPerSecond
        | Input::WheelRadians
        | Input::Diameter => &[Cause::SpeedUnit],
        Input::UnsignedSpeed => &[Cause::SpeedUnsigned],
        Input::SpeedZero => &[Cause::SpeedZero],
        Input::SpeedStuck => &[Cause::SpeedStuck],
        Input::SpeedBlind => &[Cause::SpeedBlind],
        Input::SteeringStuck => &[Cause::SteeringStuck],
        Input::LongWheelbase | Input::ShortWheelbase => &[Cause::WheelbaseWrong, Cause::TurnScale],
        Input::ToldBicycle => &[Cause::Tricycle],
        Input::ToldTricycle => &[Cause::Bicycle],
        Input::LinkageWheel => &[Cause::LinkageWheel],
        Input::Command => &[Cause::Command],
        Input::FilteredAngle => &[Cause::AngleLate],
        Input::OtherVehicle => &[Cause::OtherVehicle, Cause::SteeringUnrelated],
        Input::ScansAhead | Input::TimeZone => &[Cause::StampsApart, Cause::ClocksApart],
        Input::ScansSlightlyAhead => &[Cause::ClocksApart],
        Input::ClockStep => &[Cause::SteppedClock],
        Input::ClockBack => &[Cause::ClockBack],
        Input::WholeSeconds => &[Cause::RepeatedStamps],
        Input::Microseconds => &[Cause::NanosecondField],
        Input::ReceptionStamps => &[Cause::ReceptionStamps],
        Input::ScansEnd => &[Cause::LidarMissing],
        Input::WheelsEnd => &[Cause::WheelOdometryMissing],
        Input::Millimetres => &[Cause::Millimetres],
        Input::FewReturns => &[Cause::FewReturns],
        Input::OneRange => &[Cause::OneRange],
        Input::OwnBody => &[Cause::OwnBody],
        Input::BeamTimes => &[Cause::BeamTimes],
        Input::RepeatedScans => &[Cause::RepeatedScans],
        Input::TwoFrames => &[Cause::SeveralFrames],
        Input::Segments => &[Cause::Segments],
        Input::RepeatedPoses => &[Cause::RepeatedPoses],
        Input::JumpingPoses => &[Cause::PoseJumps],
        Input::BasePose => &[Cause::BasePose],
    }
}

/// The cause that is true of an imperfection: three tenths of a second of lag are what a command looks
/// like, and a scanner that is tilted by 3 degrees sees the floor.
pub const fn true_of(flaw: Flaw) -> &'static [Cause] {
    match flaw {
        Flaw::One(ImperfectionKind::SteeringLag, Strength::Strong) => &[Cause::Command],
        Flaw::One(ImperfectionKind::SteeringDelay, Strength::Strong) => &[Cause::AngleLate],
        Flaw::One(ImperfectionKind::Tilt, Strength::Strong) => {
            &[Cause::LidarMisled, Cause::OtherVehicle]
        }
        _ => &[],
    }
}

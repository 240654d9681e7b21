"""Differences that a firmware makes on purpose, undone before anything is judged.

ArduPilot sends ATTITUDE as its pilot wants to see it, and the quaternion as its estimator has it (in
GCS_MAVLINK_Plane::send_attitude, AP_AHRS_View::update and NavEKF3's getEulerAngles):

- `ahrs_trim`: AHRS_TRIM_X/Y are subtracted from roll and pitch, and turn the quaternion about the body's axes;
- `pitch_trim`: ArduPlane subtracts PTCH_TRIM_DEG (older: TRIM_PITCH_CD) from pitch, unless FLIGHT_OPTIONS says no;
- `vtol_view`: a plane that hovers shows a view of the body that is pitched by Q_TRIM_PITCH, and by 90° on tailsitters.

The Euler angles of each sample are turned into the attitude that the quaternion ought to show. Four rules keep a fault
from being explained away:

1. Parameters and modes predict. What they predict counts from the frame that tells it. Pairs of one instant have the
   last word: where the stream shows nothing of what was told (another version of the firmware), nothing is undone.
2. What was not told is fitted, to a few pairs of one instant, and only in the form that the firmware gives it. Such
   pairs agree to some 1e-5°, so a fit that leaves more than 1e-4° is none. A pitch trim and AHRS_TRIM are never fitted
   together: between them they could make a mount offset about the wing. Where the two messages rarely or never carry
   one stamp, the quaternion is interpolated, and each pair weighs by its bound: a fit must leave no more than half of
   noise and bound, is made anew as more pairs come, and never moves by more than it was unsure of.
3. A difference that appears in a stream which agreed before may as well be a fault. It is fitted only where the motion
   tells it from a mount offset and a wrong sign, as is a pitch trim that had been told, and has another value since. At
   the start these are named as alternatives, and the fit is given up for good if a pair denies it before the motion has
   told.
4. A view goes with the mode. The mode may be told late, for heartbeats are lost, and a tailsitter turns seconds behind
   it: there the samples say which view it is. Beyond, a view without its mode is a fault. Where no quaternion comes,
   the down that the accelerometer felt tells a plane on its tail from one on its wings.

PX4 tailsitters' `repr_offset_q` is for displays and has no place here. This package knows neither frames on a wire nor
limits of alarms. A sample's correction rests on what came before it, in order of arrival, however the input was cut.

**between**, between_fits, between_view: pairs of neighbouring instants · felt: the down that is felt · shown_view:
which view a sample shows · latest, quiet: what is no news, compiled · explanations: what the report tells.
"""

from gcs_bridge.expected.corrected import Corrected
from gcs_bridge.expected.correction import AHRS_TRIM, CAUSE_NAMES, PITCH_TRIM, VTOL_VIEW
from gcs_bridge.expected.vehicle import Expected

__all__ = ["AHRS_TRIM", "CAUSE_NAMES", "PITCH_TRIM", "VTOL_VIEW", "Corrected", "Expected"]

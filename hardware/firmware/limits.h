// Plausible numbers of a joint's configuration. hardware/servo_limits.py has the same in Python; tests compare the two.
//
// Raw values are microseconds of pulse, or the byte of a smart servo; a step is the greatest change per servo frame, in
// sixteenths of a raw value. A calibration that the host would refuse must not move a servo, whoever sends it.
#pragma once

enum { PULSE_LOW = 400, PULSE_HIGH = 2600, PULSE_MAX_STEP = 8000 };
enum { SMART_LOW = 24, SMART_HIGH = 232, SMART_MAX_STEP = 640 };

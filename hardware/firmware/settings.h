// What may be changed before the firmware is built.
#pragma once

// Bits per second of the serial line: 115200 for a wire, 57600 for a Bluetooth module. `make BAUD=57600` sets it, too.
#ifndef BAUD
#define BAUD 115200UL
#endif

// The serial port, both ways through ring buffers that interrupts fill and empty.
#pragma once
#include <stdbool.h>
#include <stdint.h>

void serial_begin(void);
bool serial_read(uint8_t *byte);  // false if there is none; EVENT_BYTES follows every byte
void serial_write(const uint8_t *bytes, uint8_t count);  // all or, without room, nothing

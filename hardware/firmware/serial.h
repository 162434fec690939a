// The serial port, both ways through rings that interrupts fill and empty.
#pragma once
#include <stdbool.h>
#include <stdint.h>

void serial_begin(void);
bool serial_read(uint8_t *byte);  // false if none waits; NEWS_BYTES says when to look
void serial_write(const uint8_t *bytes, uint8_t count);  // all, or nothing where there is no room

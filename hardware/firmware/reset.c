#include "reset.h"

#include <avr/io.h>
#include <avr/wdt.h>

uint8_t reset_cause __attribute__((section(".noinit")));

// After a watchdog reset the watchdog runs on with its shortest time: switch it off before memory is even cleared.
void before_main(void) __attribute__((naked, used, section(".init3")));
void before_main(void) {
  reset_cause = MCUSR;
  MCUSR = 0;
  wdt_disable();
}

// Two one-wire chains of smart modules on D8 and D9, in step with each other. Timer 0.
#pragma once
#include <stdint.h>

#include "chain.h"

void bus_use(uint8_t mask);  // chains to talk to; EVENT_ANSWERS follows at once, and again after every packet

void bus_answers(uint8_t answers[CHAINS]);  // answer of each chain, 0 for silence
void bus_send(uint8_t packets[CHAINS][PACKET_BYTES]);

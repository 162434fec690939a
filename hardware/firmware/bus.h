// Two one-wire chains of smart modules on D8 and D9, in step with each other. Timer 0.
#pragma once
#include <stdint.h>

#include "chain.h"

void bus_use(uint8_t mask);  // which chains to talk to; each packet's end is NEWS_ANSWERS, and so is their beginning

void bus_answers(uint8_t answers[CHAINS]);  // what each chain answered, 0 for silence
void bus_send(uint8_t packets[CHAINS][PACKET_BYTES]);

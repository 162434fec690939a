// Packets to a chain of up to four Meccano smart modules, and its answers: discovery, goals, read-back. Plain C.
#pragma once
#include <stdint.h>

#include "protocol.h"

enum { PACKET_BYTES = 6, POSITION_LOW = 0x18, POSITION_HIGH = 0xE8 };

// Build the next packet; the place that must answer changes from packet to packet, over all four.
void chain_packet(uint8_t chain, uint8_t packet[PACKET_BYTES]);

// Take the answer to that packet; 0 for silence.
void chain_answer(uint8_t chain, uint8_t answer);

uint8_t chain_check_byte(const uint8_t data[PLACES], uint8_t place);

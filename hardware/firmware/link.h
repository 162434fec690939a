// Messages in and answers out. Plain C; the board functions declared here are defined in main.c.
#pragma once
#include <stdbool.h>
#include <stdint.h>

bool link_take(uint8_t byte);  // true if the byte completed a message

uint32_t board_now_us(void);
void board_send(const uint8_t *bytes, uint8_t count);  // all or, without room, nothing: the host then asks again

struct board {
  uint16_t boots, vcc_mv;
  uint8_t reset_cause;
};
extern struct board board;

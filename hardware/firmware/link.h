// Messages in and answers out. Plain C; what it needs of the board is declared here and defined in main.c.
#pragma once
#include <stdbool.h>
#include <stdint.h>

bool link_take(uint8_t byte);  // whether that completed a message

uint32_t board_now_us(void);
void board_send(const uint8_t *bytes, uint8_t count);  // all or, without room, nothing: the host asks again

struct board {
  uint16_t boots, vcc_mv;
  uint8_t reset_cause;
};
extern struct board board;

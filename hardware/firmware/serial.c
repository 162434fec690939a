#include "serial.h"

#include <avr/interrupt.h>
#include <avr/io.h>

#include "events.h"
#include "settings.h"

enum { RING = 128 };  // 11 ms at 115200 baud

static volatile uint8_t in[RING], in_head, in_tail, out[RING], out_head, out_tail;

void serial_begin(void) {
  UCSR0A = 1 << U2X0;
  UBRR0 = (F_CPU / 4 / BAUD - 1) / 2;
  UCSR0B = 1 << RXEN0 | 1 << TXEN0 | 1 << RXCIE0;
  UCSR0C = 1 << UCSZ01 | 1 << UCSZ00;
}

ISR(USART_RX_vect) {
  uint8_t byte = UDR0, at = in_head, next = (uint8_t)(at + 1) % RING;
  if (next == in_tail) return;  // a lost byte: the frame's CRC will not match
  in[at] = byte;
  in_head = next;
  EVENTS |= EVENT_BYTES;
}

ISR(USART_UDRE_vect) {
  uint8_t at = out_tail, next = (uint8_t)(at + 1) % RING;
  UDR0 = out[at];
  out_tail = next;
  if (next == out_head) UCSR0B &= (uint8_t)~(1 << UDRIE0);
}

bool serial_read(uint8_t *byte) {
  uint8_t at = in_tail;
  if (at == in_head) return false;
  *byte = in[at];
  in_tail = (uint8_t)(at + 1) % RING;
  return true;
}

void serial_write(const uint8_t *bytes, uint8_t count) {
  uint8_t room = (uint8_t)(out_tail - out_head - 1) % RING;
  if (count > room) return;
  for (uint8_t i = 0; i < count; i++) {
    out[out_head] = bytes[i];
    out_head = (out_head + 1) % RING;
  }
  UCSR0B |= 1 << UDRIE0;
}

/* The firmware's binary in simavr, for ctypes: virtual time, a log of pins exact to the cycle, modeled smart modules.
 *
 * Built at test time against the distribution's libsimavr and never shipped. */
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_cycle_timers.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_irq.h>
#include <simavr/sim_time.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "core.h"

enum { CHAINS = 2, PLACES = 4, MHZ = 16, BIT = 417 * MHZ, RX_ROOM = 3, SERVO_PINS = 6, FIRST_PIN = 2 };

typedef struct { uint64_t cycle; uint8_t pin, level; } edge_t;
typedef struct { uint64_t cycle; uint8_t byte; } stamped_t;
typedef struct { uint64_t cycle; uint8_t chain, data[5], answer; } packet_t;

#define LIST(type) struct { type *at; size_t count, room; }
#define PUSH(list, value) do { \
    if ((list).count == (list).room) { \
      (list).room = (list).room ? 2 * (list).room : 1024; \
      (list).at = realloc((list).at, (list).room * sizeof *(list).at); \
    } \
    (list).at[(list).count++] = (value); } while (0)

typedef struct { int present, claimed, is_servo, hand, limp, mute; double position, goal; } module_t;

struct bench;
typedef struct {
  struct bench *bench;
  int index, bit, bytes, driving, step, dip_us;
  uint8_t byte, packet[6], answer;
  module_t modules[PLACES];
  avr_irq_t *pin;
} chain_t;

typedef struct { struct bench *bench; uint8_t pin; } probe_t;

typedef struct bench {
  avr_t *avr;
  op_t *ops; /* decoded instructions of the program; none if simavr runs them all */
  avr_uart_t *uart;
  LIST(edge_t) edges;
  LIST(stamped_t) sent, coming;
  LIST(packet_t) packets;
  size_t delivered;
  int coming_armed, overruns;
  uint64_t byte_cycles, slept;
  chain_t chains[CHAINS];
  probe_t probes[SERVO_PINS];
} bench_t;

static void no_sleep(avr_t *avr, avr_cycle_count_t cycles) { (void)avr; (void)cycles; }
/* End of a run. Stays until it is canceled: a chip that falls asleep in that very cycle would otherwise sleep until the
 * next event, past bytes that are yet to be fed. */
static avr_cycle_count_t end(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)when; (void)param;
  return avr->cycle + 1;
}

static void on_pin(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  probe_t *probe = param;
  bench_t *b = probe->bench;
  edge_t edge = {b->avr->cycle, probe->pin, value & 1};
  PUSH(b->edges, edge);
}

static void on_byte(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  bench_t *b = param;
  stamped_t sent = {b->avr->cycle, (uint8_t)value};
  PUSH(b->sent, sent);
}

/* ---- bytes towards the firmware, one line time apart; a third unread byte overruns as in the real receiver ---- */
static avr_cycle_count_t deliver(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)when;
  bench_t *b = param;
  while (b->delivered < b->coming.count && b->coming.at[b->delivered].cycle <= avr->cycle) {
    uint8_t byte = b->coming.at[b->delivered++].byte;
    if ((b->uart->input.write - b->uart->input.read & 63) >= RX_ROOM)
      b->overruns++;
    else
      avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT), byte);
  }
  if (b->delivered < b->coming.count) return b->coming.at[b->delivered].cycle;
  b->coming_armed = 0;
  return 0;
}

void bench_feed(bench_t *b, const uint8_t *bytes, int count, uint64_t cycle) {
  for (int i = 0; i < count; i++) {
    uint64_t at = cycle;
    if (b->coming.count && b->coming.at[b->coming.count - 1].cycle + b->byte_cycles > at)
      at = b->coming.at[b->coming.count - 1].cycle + b->byte_cycles;
    stamped_t coming = {at, bytes[i]};
    PUSH(b->coming, coming);
  }
  if (!b->coming_armed && b->delivered < b->coming.count) {
    uint64_t at = b->coming.at[b->delivered].cycle, now = b->avr->cycle;
    avr_cycle_timer_register(b->avr, at > now ? at - now : 1, deliver, b);
    b->coming_armed = 1;
  }
}

/* ---- modules on a chain ---- */
static int check_byte(const uint8_t *d, int place) {
  unsigned s = d[0] + d[1] + d[2] + d[3];
  s += s >> 8;
  s += s << 4;
  return (s & 0xF0) | place;
}

static uint8_t module_answer(chain_t *c) {
  const uint8_t *d = c->packet + 1;
  int asked = c->packet[5] & 3;
  for (int place = 0; place < PLACES && c->modules[place].present && c->modules[place].claimed; place++) {
    module_t *m = &c->modules[place];
    if (!m->is_servo) continue;
    m->limp = d[place] == 0xFA;
    if (m->limp && m->hand >= 0) m->position = m->hand;
    if (d[place] < 0x18 || d[place] > 0xE8) continue;
    m->goal = d[place];
    double step = 9, distance = m->goal - m->position;
    m->position += distance > step ? step : distance < -step ? -step : distance;
  }
  for (int place = 0; place < asked; place++) /* those behind hear nothing until the ones ahead have their places */
    if (!c->modules[place].present || !c->modules[place].claimed) return 0;
  module_t *m = &c->modules[asked];
  if (!m->present) return 0;
  if (d[asked] == 0xFE) {
    m->claimed = 1;
    return 0xFE;
  }
  if (!m->claimed) return 0;
  if (d[asked] == 0xFC) return m->is_servo ? 1 : 2;
  return m->mute && !m->limp ? 0 : (uint8_t)(m->position + 0.5);
}

static void drive(chain_t *c, int level) {
  c->driving = 1;
  avr_raise_irq(c->pin, (uint32_t)level);
  c->driving = 0;
}

/* Noise: the other level for a short time. */
static avr_cycle_count_t dip(avr_t *avr, avr_cycle_count_t when, void *param) {
  chain_t *c = param;
  (void)avr;
  int within = c->pin->value & 1;
  drive(c, !within);
  return within ? when + (avr_cycle_count_t)c->dip_us * MHZ : 0;
}

static avr_cycle_count_t answer_step(avr_t *avr, avr_cycle_count_t when, void *param) {
  chain_t *c = param;
  int step = c->step++;
  drive(c, step > 16 || (step & 1));
  if (step > 16) return 0; /* released */
  if (c->dip_us && step == 5) avr_cycle_timer_register(avr, 150 * MHZ, dip, c);
  int one = step ? c->answer >> ((step - 1) / 2) & 1 : 0;
  int us = step == 0 ? 2000 : step & 1 ? (one ? 733 : 367) : (one ? 367 : 733);
  return when + us * MHZ;
}

static avr_cycle_count_t sample_bit(avr_t *avr, avr_cycle_count_t when, void *param) {
  chain_t *c = param;
  uint8_t mask = (uint8_t)(1 << c->index), port = avr->data[0x25], ddr = avr->data[0x24];
  int level = !(ddr & mask) || (port & mask);
  if (c->bit < 8) {
    c->byte = (uint8_t)(c->byte >> 1 | level << 7);
    c->bit++;
    return when + BIT;
  }
  c->bit = -1;
  if (!level) { c->bytes = 0; return 0; } /* framing */
  if (c->byte == 0xFF) c->bytes = 0;
  if (c->bytes < 6) c->packet[c->bytes++] = c->byte;
  if (c->bytes == 6 && c->packet[0] == 0xFF) {
    c->bytes = 0;
    c->answer = c->packet[5] == check_byte(c->packet + 1, c->packet[5] & 3) ? module_answer(c) : 0;
    packet_t packet = {avr->cycle, (uint8_t)c->index, {0}, c->answer};
    memcpy(packet.data, c->packet + 1, 5);
    PUSH(c->bench->packets, packet);
    if (c->answer) {
      c->step = 0;
      avr_cycle_timer_register(avr, 2 * BIT + 1500 * MHZ, answer_step, c);
    }
  }
  return 0;
}

static void on_line(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  chain_t *c = param;
  uint8_t mask = (uint8_t)(1 << c->index);
  if (c->driving || (value & 1) || c->bit >= 0 || !(c->bench->avr->data[0x24] & mask)) return;
  c->bit = 0;
  c->byte = 0;
  avr_cycle_timer_register(c->bench->avr, BIT + BIT / 2, sample_bit, c);
}

/* ---- life ---- */
static avr_uart_t *find_uart(avr_t *avr) {
  for (avr_io_t *io = avr->io_port; io; io = io->next)
    if (!strcmp(io->kind, "uart")) return (avr_uart_t *)io;
  return NULL;
}

static void quiet(avr_t *avr, const int level, const char *format, va_list list) {
  (void)avr; (void)level; (void)format; (void)list;
}

/* Polling the levels of INT0 and INT1, which are not used, in every cycle would make everything ten times slower. */
static void no_level_polling(avr_t *avr) {
  for (int i = 0; i < 2; i++) avr_extint_set_strict_lvl_trig(avr, (uint8_t)i, 0);
}

bench_t *bench_new(const char *elf, uint32_t baud, int plain) {
  elf_firmware_t firmware = {0};
  avr_global_logger_set(quiet);
  if (elf_read_firmware(elf, &firmware)) return NULL;
  bench_t *b = calloc(1, sizeof *b);
  b->avr = avr_make_mcu_by_name("atmega328p");
  avr_init(b->avr);
  b->avr->frequency = MHZ * 1000000;
  avr_load_firmware(b->avr, &firmware);
  b->avr->frequency = MHZ * 1000000;
  b->avr->vcc = b->avr->avcc = 5000;
  b->avr->sleep = no_sleep;
  b->avr->run_cycle_limit = MHZ * 1000; /* whole stretches between its timers, not one instruction at a time */
  b->avr->log = LOG_NONE;
  no_level_polling(b->avr);
  b->byte_cycles = 10ull * MHZ * 1000000 / baud;
  b->uart = find_uart(b->avr);
  uint32_t flags = 0;
  avr_ioctl(b->avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  for (int i = 0; i < SERVO_PINS; i++) {
    b->probes[i] = (probe_t){b, (uint8_t)i};
    avr_irq_register_notify(avr_io_getirq(b->avr, AVR_IOCTL_IOPORT_GETIRQ('D'), FIRST_PIN + i), on_pin, &b->probes[i]);
  }
  for (int i = 0; i < CHAINS; i++) {
    chain_t *c = &b->chains[i];
    c->bench = b;
    c->index = i;
    c->bit = -1;
    c->pin = avr_io_getirq(b->avr, AVR_IOCTL_IOPORT_GETIRQ('B'), i);
    avr_irq_register_notify(c->pin, on_line, c);
    for (int k = 0; k < PLACES; k++) c->modules[k] = (module_t){.is_servo = 1, .hand = -1};
  }
  avr_irq_register_notify(avr_io_getirq(b->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_byte, b);
  if (!plain) core_decode(b->avr, b->ops = calloc(OPS, sizeof *b->ops));
  memset(b->avr->data + 0x100, 0xC5, 0x800); /* painted, to measure the depth of the stack */
  return b;
}

void bench_free(bench_t *b) {
  avr_terminate(b->avr);
  free(b->avr);
  free(b->ops);
  free(b->edges.at);
  free(b->sent.at);
  free(b->coming.at);
  free(b->packets.at);
  free(b);
}

/* Run to a cycle; return the number of bytes sent so far, or -1 after a crash. */
int64_t bench_run(bench_t *b, uint64_t until) {
  avr_t *avr = b->avr;
  if (until > avr->cycle) avr_cycle_timer_register(avr, until - avr->cycle, end, b);
  while (avr->cycle < until) {
    if (b->ops) {
      core_run(avr, b->ops);
      avr->run_cycle_count = 1; /* one instruction, and back */
    }
    uint64_t before = avr->cycle;
    int state = avr_run(avr);
    if (state == cpu_Sleeping) b->slept += avr->cycle - before;
    if (state == cpu_Done || state == cpu_Crashed) return -1;
    b->uart->cycles_per_byte = b->byte_cycles;
  }
  avr_cycle_timer_cancel(avr, end, b);
  return (int64_t)b->sent.count;
}

void bench_reset(bench_t *b) {
  avr_reset(b->avr);
  no_level_polling(b->avr);
}
void bench_hang(bench_t *b, uint32_t address) {
  b->avr->pc = address;
  b->avr->sreg[S_I] = 0;
  b->avr->state = cpu_Running;
}
uint64_t bench_cycle(bench_t *b) { return b->avr->cycle; }
uint64_t bench_slept(bench_t *b) { return b->slept; }
int bench_overruns(bench_t *b) { return b->overruns; }
uint8_t bench_memory(bench_t *b, uint16_t address) { return b->avr->data[address]; }

const edge_t *bench_edges(bench_t *b, size_t *count) { *count = b->edges.count; return b->edges.at; }
const stamped_t *bench_sent(bench_t *b, size_t *count) { *count = b->sent.count; return b->sent.at; }
const packet_t *bench_packets(bench_t *b, size_t *count) { *count = b->packets.count; return b->packets.at; }

void bench_module(bench_t *b, int chain, int place, int present, int position) {
  module_t *m = &b->chains[chain].modules[place];
  if (present && !m->present) m->position = m->goal = position;
  if (!present) /* those behind are cut off too */
    for (int k = place; k < PLACES; k++) b->chains[chain].modules[k].claimed = 0;
  m->present = present;
}
void bench_mute(bench_t *b, int chain, int place, int mute) { b->chains[chain].modules[place].mute = mute; }
void bench_dip(bench_t *b, int chain, int us) { b->chains[chain].dip_us = us; }
void bench_hand(bench_t *b, int chain, int place, int hand) { b->chains[chain].modules[place].hand = hand; }
int bench_position(bench_t *b, int chain, int place) { return (int)(b->chains[chain].modules[place].position + 0.5); }

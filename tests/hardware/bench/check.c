/* Random programs, step by step in simavr and in core.c: registers, memory, flags and cycles must agree.
 *
 * check PROGRAMS; prints the instruction at which the two differ, or the number of instructions and kinds core.c ran. */
#include "core.h"

#include <simavr/sim_core.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { STEPS = 5000, CODE = 0x8000, PLAIN_RAM = 0x100 };

static uint64_t state = 1;
static uint32_t any(void) { /* xorshift */
  state ^= state << 13; state ^= state >> 7; state ^= state << 17;
  return (uint32_t)(state >> 16);
}

static void quiet(avr_t *avr, const int level, const char *format, va_list list) {
  (void)avr; (void)level; (void)format; (void)list;
}
static void no_sleep(avr_t *avr, avr_cycle_count_t cycles) { (void)avr; (void)cycles; }

static avr_t *chip(void) {
  avr_t *avr = avr_make_mcu_by_name("atmega328p");
  avr_init(avr);
  avr->sleep = no_sleep;
  avr->log = LOG_NONE;
  return avr;
}

/* A state as a compiler might produce: pointers mostly hold addresses in memory, everything else is arbitrary. */
static void prepare(avr_t *avr, const uint8_t *code, const uint8_t *data) {
  avr_reset(avr);
  memcpy(avr->flash, code, CODE);
  memcpy(avr->data, data, 32);
  memcpy(avr->data + PLAIN_RAM, data + PLAIN_RAM, avr->ramend + 1 - PLAIN_RAM);
  for (int pair = 26; pair < 32; pair += 2) avr->data[pair + 1] = 1 + avr->data[pair + 1] % 7;
  avr->data[R_SPL] = 0;
  avr->data[R_SPH] = 5;
  for (int flag = 0; flag < S_I; flag++) avr->sreg[flag] = data[40] >> flag & 1;
  avr->state = cpu_Running;
}

static int same(avr_t *a, avr_t *b) {
  return a->pc == b->pc && a->cycle == b->cycle && a->state == b->state && !memcmp(a->sreg, b->sreg, sizeof a->sreg) &&
         !memcmp(a->data, b->data, a->ramend + 1u);
}

/* Too rare in random programs: nop, cli, jumps, calls, returns, and an address in memory. */
static const uint16_t rare[] = {0x0000, 0x94F8, 0x940C, 0x940E, 0x9409, 0x9509, 0x9508, 0x0321};

int main(int count, char **arguments) {
  static uint8_t code[CODE], data[0x900];
  static op_t ops[OPS];
  static uint64_t ran[256];
  int programs = count > 1 ? atoi(arguments[1]) : 100, kinds = 0;
  uint64_t all = 0;
  avr_global_logger_set(quiet);
  avr_t *theirs = chip(), *ours = chip();
  for (int program = 0; program < programs; program++) {
    for (int i = 0; i < CODE; i += 2) {
      uint16_t word = any() % 8 ? (uint16_t)any() : rare[any() % (sizeof rare / sizeof *rare)];
      if ((word & 0xFE0C) == 0x960C) word = 0; /* adiw and sbiw that simavr 1.6 takes for two words where it skips them */
      code[i] = (uint8_t)word;
      code[i + 1] = (uint8_t)(word >> 8);
    }
    for (size_t i = 0; i < sizeof data; i++) data[i] = (uint8_t)any();
    prepare(theirs, code, data);
    prepare(ours, code, data);
    theirs->cycle = ours->cycle = 0;
    core_decode(ours, ops);
    for (int step = 0; step < STEPS && ours->state == cpu_Running; step++) {
      uint32_t at = ours->pc;
      uint64_t before = ours->cycle;
      ours->run_cycle_count = 5; /* room for one instruction */
      core_run(ours, ops);
      if (ours->cycle == before) { /* left to simavr: continue elsewhere */
        ours->pc = theirs->pc = 2 * (any() % (CODE / 2));
        continue;
      }
      theirs->run_cycle_count = 1;
      theirs->pc = avr_run_one(theirs);
      ran[ops[at / 2].kind]++;
      all++;
      if (same(ours, theirs)) continue;
      printf("program %d, step %d: they differ at %04x, instruction %02x%02x\n", program, step, at, code[at + 1], code[at]);
      return 1;
    }
  }
  for (int kind = 0; kind < 256; kind++) kinds += ran[kind] > 0;
  printf("%llu instructions of %d kinds\n", (unsigned long long)all, kinds);
  return 0;
}

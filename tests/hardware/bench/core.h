/* The most frequent instructions of simavr's chip, run faster; for bench.c. */
#include <simavr/sim_avr.h>
#include <stdint.h>

typedef struct { uint8_t kind, d, r; uint16_t k; } op_t;
enum { OPS = 65536 };

/* Decode every instruction once, after the chip's peripherals exist; `ops` has room for OPS, zeroed. */
void core_decode(const avr_t *avr, op_t *ops);

/* Run as avr_run would, until an instruction that is left to it, or until shortly before its next timer. */
void core_run(avr_t *avr, const op_t *ops);

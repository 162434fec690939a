/* The instructions that a compiler uses most, decoded once, as far as they touch only registers and plain memory. All
 * others, accesses to peripheral registers, interrupts and the last cycles before a timer are left to simavr, which finds
 * the chip in the state that it would have reached itself, to the cycle. A test compares runs with and without this. */
#include "core.h"

#include <simavr/sim_core.h>
#include <stddef.h>

enum { X = 26, Y = 28, Z = 30, RAM = 0x100, LONGEST = 4 };

enum kind {
  LEFT, CPC, SBC, ADD, CPSE, CP, SUB, ADC, AND, EOR, OR, MOV, MOVW, MUL, CPI, SBCI, SUBI, ORI, ANDI, LDI,
  LDD, STD, LD, LD_INC, LD_DEC, ST, ST_INC, ST_DEC, LDS, STS, LPM, LPM_INC, POP, PUSH, IN, OUT, IN_SREG, OUT_SREG, CLI,
  COM, NEG, SWAP, INC, ASR, LSR, ROR, DEC, ADIW, SBIW, CBI, SBI, SBIC, SBIS, SBRC, SBRS, BLD, BST,
  RJMP, RCALL, JMP, CALL, IJMP, ICALL, RET, NOP, IF_SET, IF_CLEAR = IF_SET + 8,
};

/* Layout of the operands in an instruction. */
enum form { NONE, TWO, WORDS, CONST, OFFSET, ONE, PORT, WIDE, PORT_BIT, BIT, FAR, ABSOLUTE, JUMP, BRANCH };

static const struct { uint16_t mask, code; uint8_t kind, form, r; } table[] = {
    {0xFFFF, 0x0000, NOP, NONE, 0},      {0xFF00, 0x0100, MOVW, WORDS, 0},
    {0xFC00, 0x0400, CPC, TWO, 0},       {0xFC00, 0x0800, SBC, TWO, 0},       {0xFC00, 0x0C00, ADD, TWO, 0},
    {0xFC00, 0x1000, CPSE, TWO, 0},      {0xFC00, 0x1400, CP, TWO, 0},        {0xFC00, 0x1800, SUB, TWO, 0},
    {0xFC00, 0x1C00, ADC, TWO, 0},       {0xFC00, 0x2000, AND, TWO, 0},       {0xFC00, 0x2400, EOR, TWO, 0},
    {0xFC00, 0x2800, OR, TWO, 0},        {0xFC00, 0x2C00, MOV, TWO, 0},       {0xFC00, 0x9C00, MUL, TWO, 0},
    {0xF000, 0x3000, CPI, CONST, 0},     {0xF000, 0x4000, SBCI, CONST, 0},    {0xF000, 0x5000, SUBI, CONST, 0},
    {0xF000, 0x6000, ORI, CONST, 0},     {0xF000, 0x7000, ANDI, CONST, 0},    {0xF000, 0xE000, LDI, CONST, 0},
    {0xD208, 0x8000, LDD, OFFSET, Z},    {0xD208, 0x8008, LDD, OFFSET, Y},
    {0xD208, 0x8200, STD, OFFSET, Z},    {0xD208, 0x8208, STD, OFFSET, Y},
    {0xFE0F, 0x900C, LD, ONE, X},        {0xFE0F, 0x900D, LD_INC, ONE, X},    {0xFE0F, 0x900E, LD_DEC, ONE, X},
    {0xFE0F, 0x9009, LD_INC, ONE, Y},    {0xFE0F, 0x900A, LD_DEC, ONE, Y},
    {0xFE0F, 0x9001, LD_INC, ONE, Z},    {0xFE0F, 0x9002, LD_DEC, ONE, Z},
    {0xFE0F, 0x920C, ST, ONE, X},        {0xFE0F, 0x920D, ST_INC, ONE, X},    {0xFE0F, 0x920E, ST_DEC, ONE, X},
    {0xFE0F, 0x9209, ST_INC, ONE, Y},    {0xFE0F, 0x920A, ST_DEC, ONE, Y},
    {0xFE0F, 0x9201, ST_INC, ONE, Z},    {0xFE0F, 0x9202, ST_DEC, ONE, Z},
    {0xFE0F, 0x9000, LDS, FAR, 0},       {0xFE0F, 0x9200, STS, FAR, 0},
    {0xFE0F, 0x9004, LPM, ONE, 0},       {0xFE0F, 0x9005, LPM_INC, ONE, 0},
    {0xFE0F, 0x900F, POP, ONE, 0},       {0xFE0F, 0x920F, PUSH, ONE, 0},
    {0xFE0F, 0x9400, COM, ONE, 0},       {0xFE0F, 0x9401, NEG, ONE, 0},       {0xFE0F, 0x9402, SWAP, ONE, 0},
    {0xFE0F, 0x9403, INC, ONE, 0},       {0xFE0F, 0x9405, ASR, ONE, 0},       {0xFE0F, 0x9406, LSR, ONE, 0},
    {0xFE0F, 0x9407, ROR, ONE, 0},       {0xFE0F, 0x940A, DEC, ONE, 0},
    {0xFF00, 0x9600, ADIW, WIDE, 0},     {0xFF00, 0x9700, SBIW, WIDE, 0},
    {0xF800, 0xB000, IN, PORT, 0},       {0xF800, 0xB800, OUT, PORT, 0},      {0xFFFF, 0x94F8, CLI, NONE, 0},
    {0xFF00, 0x9800, CBI, PORT_BIT, 0},  {0xFF00, 0x9900, SBIC, PORT_BIT, 0},
    {0xFF00, 0x9A00, SBI, PORT_BIT, 0},  {0xFF00, 0x9B00, SBIS, PORT_BIT, 0},
    {0xFE08, 0xF800, BLD, BIT, 0},       {0xFE08, 0xFA00, BST, BIT, 0},
    {0xFE08, 0xFC00, SBRC, BIT, 0},      {0xFE08, 0xFE00, SBRS, BIT, 0},
    {0xF000, 0xC000, RJMP, JUMP, 0},     {0xF000, 0xD000, RCALL, JUMP, 0},
    {0xFFFF, 0x940C, JMP, ABSOLUTE, 0},  {0xFFFF, 0x940E, CALL, ABSOLUTE, 0},
    {0xFFFF, 0x9409, IJMP, NONE, 0},     {0xFFFF, 0x9509, ICALL, NONE, 0},    {0xFFFF, 0x9508, RET, NONE, 0},
    {0xFC00, 0xF000, IF_SET, BRANCH, 0}, {0xFC00, 0xF400, IF_CLEAR, BRANCH, 0},
};

static uint16_t word(const avr_t *avr, uint32_t at) {
  at = 2 * at;
  return at + 1 < avr->flashend ? (uint16_t)(avr->flash[at] | avr->flash[at + 1] << 8) : 0xFFFF;
}

static int is_far(uint16_t code) { return (code & 0xFC0F) == 0x9000 || (code & 0xFE0C) == 0x940C; }

/* Memory, or a register without side effects. */
static int is_plain(const avr_t *avr, uint16_t at) {
  if (at < 32 || at == R_SREG || at > avr->ramend) return 0;
  return at - 32 >= MAX_IOs || !(avr->io[at - 32].r.c || avr->io[at - 32].w.c || avr->io[at - 32].irq);
}

static op_t decode(const avr_t *avr, uint16_t pc) {
  uint16_t code = word(avr, pc), next = word(avr, pc + 1u);
  for (size_t i = 0; i < sizeof table / sizeof *table; i++) {
    if ((code & table[i].mask) != table[i].code) continue;
    op_t op = {table[i].kind, code >> 4 & 31, table[i].r, 0};
    switch (table[i].form) {
      case TWO: op.r = (code >> 5 & 16) | (code & 15); break;
      case WORDS: op.d = code >> 3 & 30; op.r = code << 1 & 30; break;
      case CONST: op.d = 16 | (code >> 4 & 15); op.k = (code >> 4 & 0xF0) | (code & 15); break;
      case OFFSET: op.k = (code >> 8 & 32) | (code >> 7 & 24) | (code & 7); break;
      case WIDE: op.d = 24 | (code >> 3 & 6); op.k = (code >> 2 & 48) | (code & 15); break;
      case PORT: op.k = 32 + ((code >> 5 & 48) | (code & 15)); break;
      case PORT_BIT: op.k = 32 + (code >> 3 & 31); op.r = (uint8_t)(1 << (code & 7)); break;
      case BIT: op.r = code & 7; break;
      case FAR: op.k = next; break;
      case ABSOLUTE: op.k = next; break;
      case JUMP: op.k = (uint16_t)(pc + 1 + ((int16_t)(code << 4) >> 4)); break;
      case BRANCH: op.k = (uint16_t)(pc + 1 + ((int16_t)(code << 6) >> 9)); op.kind += code & 7; break;
    }
    int at_port = table[i].form == PORT || table[i].form == PORT_BIT || table[i].form == FAR;
    int jumps = table[i].form == JUMP || table[i].form == BRANCH || table[i].form == ABSOLUTE;
    if (jumps && op.k > avr->flashend / 2) op.kind = LEFT;
    if (table[i].form == PORT && op.k == R_SREG)
      op.kind = op.kind == IN ? IN_SREG : OUT_SREG;
    else if (at_port && !is_plain(avr, op.k))
      op.kind = LEFT;
    if (op.kind == CPSE || table[i].form == BIT || table[i].form == PORT_BIT)
      op.d |= is_far(next) ? 128 : 0;
    return op;
  }
  return (op_t){LEFT, 0, 0, 0};
}

void core_decode(const avr_t *avr, op_t *ops) {
  for (uint32_t pc = 0; 2 * pc + 1 < avr->flashend; pc++) ops[pc] = decode(avr, (uint16_t)pc);
}

void core_run(avr_t *avr, const op_t *restrict ops) {
  if (avr->state != cpu_Running || avr->interrupt_state) return;
  uint8_t *restrict data = avr->data, *restrict f = avr->sreg;
  const uint8_t *flash = avr->flash;
  const unsigned ram_end = avr->ramend, end = avr->flashend;
  uint64_t first = avr->run_cycle_count, left = first;
  uint16_t pc = (uint16_t)(avr->pc / 2);
  uint8_t c = f[S_C], z = f[S_Z], n = f[S_N], v = f[S_V], s = f[S_S], h = f[S_H];
#define PAIR(i) (uint16_t)(data[i] | data[(i) + 1] << 8)
#define SET_PAIR(i, x) (data[i] = (uint8_t)(x), data[(i) + 1] = (uint8_t)((x) >> 8))
#define IN_RAM(at) ((at) >= RAM && (at) <= ram_end)
#define NEXT(cycles) { pc++; left -= (cycles); break; }
#define SIGN(x) (n = (uint8_t)(x) >> 7, s = n ^ v)
#define LOGIC(x) { uint8_t y = (x); data[op->d] = y; v = 0; z = !y; SIGN(y); NEXT(1) }
#define PLUS(b, carry) { \
    uint8_t x = data[op->d], w = (b), y = (uint8_t)(x + w + (carry)), over = (x & w) | (w & ~y) | (~y & x); \
    h = over >> 3 & 1; c = over >> 7; v = ((x & w & ~y) | (~x & ~w & y)) >> 7 & 1; z = !y; SIGN(y); data[op->d] = y; NEXT(1) }
#define MINUS(x0, b, carry, keep, store) { \
    uint8_t x = (x0), w = (b), y = (uint8_t)(x - w - (carry)), under = (~x & w) | (w & y) | (y & ~x); \
    h = under >> 3 & 1; c = under >> 7; v = ((x & ~w & ~y) | (~x & w & y)) >> 7 & 1; z = (keep) && !y; SIGN(y); \
    if (store) data[op->d] = y; \
    NEXT(1) }
#define SKIP(condition) { \
    int words = (condition) ? 1 + (op->d >> 7) : 0; \
    pc += 1 + words; left -= 1 + words; break; }
#define LOAD(at) { data[op->d] = data[at]; NEXT(2) }
#define STORE(at) { data[at] = data[op->d]; NEXT(2) }
#define BRANCH_IF(condition) { if (condition) TO(op->k, 2) NEXT(1) }
#define TO(target, cycles) { pc = (target); left -= (cycles); break; }
#define CALL_TO(target, cycles) { \
    uint16_t sp = PAIR(R_SPL), back = (uint16_t)(pc + op_words); \
    if (sp <= RAM || sp > ram_end) goto out; \
    data[sp] = (uint8_t)back; data[sp - 1] = back >> 8; SET_PAIR(R_SPL, sp - 2); TO(target, cycles) }
  while (left > LONGEST) {
    const op_t *op = &ops[pc];
    switch (op->kind) {
      case NOP: NEXT(1)
      case ADD: PLUS(data[op->r], 0)
      case ADC: PLUS(data[op->r], c)
      case SUB: MINUS(data[op->d], data[op->r], 0, 1, 1)
      case SBC: MINUS(data[op->d], data[op->r], c, z, 1)
      case CP: MINUS(data[op->d], data[op->r], 0, 1, 0)
      case CPC: MINUS(data[op->d], data[op->r], c, z, 0)
      case SUBI: MINUS(data[op->d], (uint8_t)op->k, 0, 1, 1)
      case SBCI: MINUS(data[op->d], (uint8_t)op->k, c, z, 1)
      case CPI: MINUS(data[op->d], (uint8_t)op->k, 0, 1, 0)
      case NEG: MINUS(0, data[op->d], 0, 1, 1)
      case AND: LOGIC(data[op->d] & data[op->r])
      case EOR: LOGIC(data[op->d] ^ data[op->r])
      case OR: LOGIC(data[op->d] | data[op->r])
      case ANDI: LOGIC(data[op->d] & op->k)
      case ORI: LOGIC(data[op->d] | op->k)
      case COM: c = 1; LOGIC(~data[op->d])
      case MOV: data[op->d] = data[op->r]; NEXT(1)
      case MOVW: data[op->d] = data[op->r]; data[op->d + 1] = data[op->r + 1]; NEXT(1)
      case LDI: data[op->d] = (uint8_t)op->k; NEXT(1)
      case MUL: { uint16_t y = data[op->d] * data[op->r]; SET_PAIR(0, y); c = y >> 15; z = !y; NEXT(2) }
      case SWAP: data[op->d] = (uint8_t)(data[op->d] >> 4 | data[op->d] << 4); NEXT(1)
      case INC: { uint8_t y = ++data[op->d]; v = y == 0x80; z = !y; SIGN(y); NEXT(1) }
      case DEC: { uint8_t y = --data[op->d]; v = y == 0x7F; z = !y; SIGN(y); NEXT(1) }
      case LSR: case ROR: case ASR: {
        uint8_t x = data[op->d], high = op->kind == ROR ? c << 7 : op->kind == ASR ? x & 0x80 : 0, y = x >> 1 | high;
        data[op->d] = y; c = x & 1; v = (y >> 7) ^ c; z = !y; SIGN(y); NEXT(1) }
      case ADIW: {
        uint16_t x = PAIR(op->d), y = (uint16_t)(x + op->k);
        v = (~x & y) >> 15 & 1; c = (~y & x) >> 15 & 1; z = !y; SIGN(y >> 8); SET_PAIR(op->d, y); NEXT(2) }
      case SBIW: {
        uint16_t x = PAIR(op->d), y = (uint16_t)(x - op->k);
        v = (x & ~y) >> 15 & 1; c = (y & ~x) >> 15 & 1; z = !y; SIGN(y >> 8); SET_PAIR(op->d, y); NEXT(2) }
      case LDD: { uint16_t at = PAIR(op->r) + op->k; if (!IN_RAM(at)) goto out; LOAD(at) }
      case STD: { uint16_t at = PAIR(op->r) + op->k; if (!IN_RAM(at)) goto out; STORE(at) }
      case LD: { uint16_t at = PAIR(op->r); if (!IN_RAM(at)) goto out; LOAD(at) }
      case ST: { uint16_t at = PAIR(op->r); if (!IN_RAM(at)) goto out; STORE(at) }
      case LD_INC: { uint16_t at = PAIR(op->r); if (!IN_RAM(at)) goto out; SET_PAIR(op->r, at + 1); LOAD(at) }
      case ST_INC: { uint16_t at = PAIR(op->r); if (!IN_RAM(at)) goto out; data[at] = data[op->d]; SET_PAIR(op->r, at + 1); NEXT(2) }
      case LD_DEC: { uint16_t at = PAIR(op->r) - 1; if (!IN_RAM(at)) goto out; SET_PAIR(op->r, at); LOAD(at) }
      case ST_DEC: { uint16_t at = PAIR(op->r) - 1; if (!IN_RAM(at)) goto out; data[at] = data[op->d]; SET_PAIR(op->r, at); NEXT(2) }
      case LDS: data[op->d] = data[op->k]; TO(pc + 2, 2)
      case STS: data[op->k] = data[op->d]; TO(pc + 2, 2)
      case LPM: { uint16_t at = PAIR(Z); if (at > end) goto out; data[op->d] = flash[at]; NEXT(3) }
      case LPM_INC: { uint16_t at = PAIR(Z); if (at > end) goto out; data[op->d] = flash[at]; SET_PAIR(Z, at + 1); NEXT(3) }
      case POP: { uint16_t sp = PAIR(R_SPL) + 1; if (!IN_RAM(sp)) goto out; SET_PAIR(R_SPL, sp); LOAD(sp) }
      case PUSH: { uint16_t sp = PAIR(R_SPL); if (!IN_RAM(sp)) goto out; SET_PAIR(R_SPL, sp - 1); STORE(sp) }
      case IN: data[op->d] = data[op->k]; NEXT(1)
      case OUT: data[op->k] = data[op->d]; NEXT(1)
      case IN_SREG:
        data[R_SREG] = data[op->d] =
            (uint8_t)(c | z << 1 | n << 2 | v << 3 | s << 4 | h << 5 | f[S_T] << 6 | f[S_I] << 7);
        NEXT(1)
      case OUT_SREG: {
        uint8_t x = data[op->d];
        if (x >> 7 && !f[S_I]) goto out; /* a pending interrupt may come now */
        data[R_SREG] = x;
        c = x & 1; z = x >> 1 & 1; n = x >> 2 & 1; v = x >> 3 & 1; s = x >> 4 & 1; h = x >> 5 & 1;
        f[S_T] = x >> 6 & 1; f[S_I] = x >> 7;
        NEXT(1) }
      case CLI: f[S_I] = 0; NEXT(1)
      case CBI: data[op->k] &= (uint8_t)~op->r; NEXT(2)
      case SBI: data[op->k] |= op->r; NEXT(2)
      case SBIC: SKIP(!(data[op->k] & op->r))
      case SBIS: SKIP(data[op->k] & op->r)
      case SBRC: SKIP(!(data[op->d & 31] >> op->r & 1))
      case SBRS: SKIP(data[op->d & 31] >> op->r & 1)
      case CPSE: SKIP(data[op->d & 31] == data[op->r])
      case BST: f[S_T] = data[op->d & 31] >> op->r & 1; NEXT(1)
      case BLD: {
        uint8_t *x = &data[op->d & 31];
        *x = (uint8_t)((*x & ~(1 << op->r)) | f[S_T] << op->r); NEXT(1) }
      case RJMP: TO(op->k, 2)
      case JMP: TO(op->k, 3)
      case IJMP: TO(PAIR(Z), 2)
      case RCALL: { enum { op_words = 1 }; CALL_TO(op->k, 3) }
      case ICALL: { enum { op_words = 1 }; CALL_TO(PAIR(Z), 3) }
      case CALL: { enum { op_words = 2 }; CALL_TO(op->k, 4) }
      case RET: {
        uint16_t sp = PAIR(R_SPL);
        if (!IN_RAM(sp) || sp + 2u > ram_end) goto out;
        SET_PAIR(R_SPL, sp + 2);
        TO((uint16_t)(data[sp + 1] << 8 | data[sp + 2]), 4) }
      case IF_SET + S_C: BRANCH_IF(c)
      case IF_SET + S_Z: BRANCH_IF(z)
      case IF_SET + S_N: BRANCH_IF(n)
      case IF_SET + S_S: BRANCH_IF(s)
      case IF_SET + S_T: BRANCH_IF(f[S_T])
      case IF_CLEAR + S_C: BRANCH_IF(!c)
      case IF_CLEAR + S_Z: BRANCH_IF(!z)
      case IF_CLEAR + S_N: BRANCH_IF(!n)
      case IF_CLEAR + S_S: BRANCH_IF(!s)
      case IF_CLEAR + S_T: BRANCH_IF(!f[S_T])
      default: goto out;
    }
  }
out:
  avr->cycle += first - left;
  avr->run_cycle_count = left;
  avr->pc = 2u * pc;
  f[S_C] = c; f[S_Z] = z; f[S_N] = n; f[S_V] = v; f[S_S] = s; f[S_H] = h;
}

/* A plugin for qemu-arm: counts the instructions that a program executes, by what they cost a Cortex-A8.
 *
 * Purpose: cycle_time.py's count for the small box. Its floating-point unit (VFPLite) is not pipelined: an operation on doubles
 *          takes as long as some twenty other instructions, so those are counted apart.
 * Output:  one line on stderr at the end, "instructions N add N multiply N accumulate N divide N other N status N".
 * Reads:   Thumb-2 and ARM code; a plugin sees the bytes of each instruction once, when its block is translated.
 * Source:  QEMU's plugin interface, version 1; ARM Architecture Reference Manual ARMv7-A, A7.5, floating-point data processing.
 */
#include <inttypes.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

/* ---- what is used of the interface ---- */

struct qemu_plugin_tb;
struct qemu_plugin_insn;
struct qemu_info;
enum { INLINE_ADD_U64 = 0 };

size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *block);
struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *block, size_t index);
const void *qemu_plugin_insn_data(const struct qemu_plugin_insn *instruction);
size_t qemu_plugin_insn_size(const struct qemu_plugin_insn *instruction);
void qemu_plugin_register_vcpu_tb_trans_cb(uint64_t id, void (*translated)(uint64_t id, struct qemu_plugin_tb *block));
void qemu_plugin_register_vcpu_tb_exec_inline(struct qemu_plugin_tb *block, int operation, void *counter,
                                              uint64_t value);
void qemu_plugin_register_atexit_cb(uint64_t id, void (*ended)(uint64_t id, void *context), void *context);

extern int qemu_plugin_version;
int qemu_plugin_install(uint64_t id, const struct qemu_info *info, int argc, char **argv);

int qemu_plugin_version = 1;

/* ---- counting ---- */

typedef enum kind { ADD, MULTIPLY, ACCUMULATE, DIVIDE, OTHER, STATUS, KINDS, ORDINARY = KINDS } kind;

static const char *const NAMES[KINDS] = {"add", "multiply", "accumulate", "divide", "other", "status"};
static uint64_t instructions;
static uint64_t counts[KINDS];

/* First half-word and second half-word of a 32-bit Thumb instruction, or of an ARM one in the same order: coprocessor
 * instructions are laid out alike. */
static kind kind_of(unsigned first, unsigned second) {
    if (first == 0xEEF1 && second == 0xFA10) {
        return STATUS; /* VMRS: waits until the unit is empty */
    }
    bool processing = (first & 0x0F00) == 0x0E00 && (second & 0x0E10) == 0x0A00;
    if (!processing) {
        return ORDINARY;
    }
    switch (first & 0x00B0) {
    case 0x0000: /* VMLA, VMLS */
    case 0x0010: /* VNMLA, VNMLS */
    case 0x0090:
    case 0x00A0: /* VFMA and its kin; a Cortex-A8 has none */
        return ACCUMULATE;
    case 0x0020:
        return MULTIPLY;
    case 0x0030:
        return ADD;
    case 0x0080:
        return DIVIDE;
    default: /* 0x00B0: VSQRT, and moves, comparisons and conversions */
        return (first & 0x000F) == 0x0001 && (second & 0x00C0) == 0x00C0 ? DIVIDE : OTHER;
    }
}

static kind look_at(const struct qemu_plugin_insn *instruction) {
    const unsigned char *bytes = qemu_plugin_insn_data(instruction);
    if (qemu_plugin_insn_size(instruction) != 4) {
        return ORDINARY;
    }
    unsigned low = bytes[0] | (unsigned)bytes[1] << 8;
    unsigned high = bytes[2] | (unsigned)bytes[3] << 8;
    bool thumb = (low & 0xF000) >= 0xE000 && (low & 0x1800) != 0; /* else ARM's, whose first half-word lies behind */
    return thumb && (low & 0xFC00) == 0xEC00 ? kind_of(low, high) : kind_of(high, low);
}

static void translated(uint64_t id, struct qemu_plugin_tb *block) {
    size_t count = qemu_plugin_tb_n_insns(block);
    uint64_t found[KINDS] = {0};
    (void)id;
    for (size_t i = 0; i < count; i++) {
        kind what = look_at(qemu_plugin_tb_get_insn(block, i));
        if (what != ORDINARY) {
            found[what]++;
        }
    }
    qemu_plugin_register_vcpu_tb_exec_inline(block, INLINE_ADD_U64, &instructions, count);
    for (size_t i = 0; i < KINDS; i++) {
        if (found[i] > 0) {
            qemu_plugin_register_vcpu_tb_exec_inline(block, INLINE_ADD_U64, &counts[i], found[i]);
        }
    }
}

static void ended(uint64_t id, void *context) {
    (void)id;
    (void)context;
    (void)fprintf(stderr, "instructions %" PRIu64, instructions);
    for (size_t i = 0; i < KINDS; i++) {
        (void)fprintf(stderr, " %s %" PRIu64, NAMES[i], counts[i]);
    }
    (void)fputs("\n", stderr);
}

int qemu_plugin_install(uint64_t id, const struct qemu_info *info, int argc, char **argv) {
    (void)info;
    (void)argc;
    (void)argv;
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, ended, NULL);
    return 0;
}

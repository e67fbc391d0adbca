/* QEMU plugin: counts the instructions of every call of some functions, with everything they call.
 *
 *   qemu-system-arm ... -plugin libcount_instructions.so,out=calls.bin,watch=0x1234,watch=0x5678
 *
 * A call begins when the function's first instruction executes and ends when the instruction after the call is reached, so both
 * the first instruction and the return are counted and nothing of the caller is. `out` receives two 32-bit words per call, in the
 * order of the returns: the number of the watched function (0 = first) and the instructions executed. Conditional instructions count
 * whether or not their condition holds, as they do on the processor.
 *
 * The distributions ship QEMU without its plugin header, so the few declarations stand here (interface version 1, QEMU 6.0 to 8.2). */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef uint64_t qemu_plugin_id_t;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
struct qemu_info;
enum qemu_plugin_cb_flags { QEMU_PLUGIN_CB_NO_REGS };
typedef void (*tb_callback)(qemu_plugin_id_t id, struct qemu_plugin_tb *tb);
typedef void (*insn_callback)(unsigned int cpu, void *data);
typedef void (*exit_callback)(qemu_plugin_id_t id, void *data);

void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t id, tb_callback callback);
void qemu_plugin_register_vcpu_insn_exec_cb(struct qemu_plugin_insn *insn, insn_callback callback, enum qemu_plugin_cb_flags flags,
                                            void *data);
void qemu_plugin_register_atexit_cb(qemu_plugin_id_t id, exit_callback callback, void *data);
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *tb);
struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *tb, size_t index);
uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn *insn);
size_t qemu_plugin_insn_size(const struct qemu_plugin_insn *insn);

#define EXPORT __attribute__((visibility("default")))
#define MAX_WATCHED 64
#define MAX_DEPTH   64
#define NOT_WATCHED (-1)

EXPORT int qemu_plugin_version = 1;
EXPORT int qemu_plugin_install(qemu_plugin_id_t id, const struct qemu_info *info, int argc, char **argv);

/* One instruction of the guest, as long as the emulator may execute it. */
struct instruction {
    uint64_t next_address;
    uint64_t address;
    int watched;
};

struct call {
    uint64_t return_address;
    uint64_t executed_before;
    int watched;
};

static uint64_t watched_address[MAX_WATCHED];
static int watched_count;
static struct call calls[MAX_DEPTH];
static int depth;
static uint64_t executed, last_next_address;
static FILE *out;

static int watched_index(uint64_t address)
{
    for (int i = 0; i < watched_count; i++) {
        if (watched_address[i] == address) {
            return i;
        }
    }
    return NOT_WATCHED;
}

static void finish(const struct call *call)
{
    const uint32_t record[2] = {(uint32_t)call->watched, (uint32_t)(executed - call->executed_before)};
    fwrite(record, sizeof record, 1, out);
}

/* A function that was jumped to instead of called ends together with the one that jumped: look below the top, too. */
static void end_calls(uint64_t address)
{
    for (int i = depth; i > 0; i--) {
        if (calls[i - 1].return_address == address) {
            while (depth >= i) {
                finish(&calls[--depth]);
            }
            return;
        }
    }
}

static void execute(unsigned int cpu, void *data)
{
    const struct instruction *instruction = data;
    (void)cpu;
    if (depth > 0 && instruction->address != last_next_address) {
        end_calls(instruction->address);
    }
    if (instruction->watched != NOT_WATCHED && depth < MAX_DEPTH) {
        calls[depth++] = (struct call){last_next_address, executed, instruction->watched};
    }
    executed++;
    last_next_address = instruction->next_address;
}

static void translate(qemu_plugin_id_t id, struct qemu_plugin_tb *tb)
{
    (void)id;
    for (size_t i = 0; i < qemu_plugin_tb_n_insns(tb); i++) {
        struct qemu_plugin_insn *insn = qemu_plugin_tb_get_insn(tb, i);
        struct instruction *instruction = malloc(sizeof *instruction); /* kept: translated code refers to it to the end */
        if (instruction == NULL) {
            abort();
        }
        instruction->address = qemu_plugin_insn_vaddr(insn);
        instruction->next_address = instruction->address + qemu_plugin_insn_size(insn);
        instruction->watched = watched_index(instruction->address);
        qemu_plugin_register_vcpu_insn_exec_cb(insn, execute, QEMU_PLUGIN_CB_NO_REGS, instruction);
    }
}

static void at_exit(qemu_plugin_id_t id, void *data)
{
    (void)id;
    (void)data;
    fclose(out);
}

static bool take_argument(const char *argument)
{
    if (strncmp(argument, "out=", 4) == 0 && out == NULL) {
        out = fopen(argument + 4, "wb");
        return out != NULL;
    }
    if (strncmp(argument, "watch=", 6) == 0 && watched_count < MAX_WATCHED) {
        watched_address[watched_count++] = strtoull(argument + 6, NULL, 0);
        return true;
    }
    return false;
}

int qemu_plugin_install(qemu_plugin_id_t id, const struct qemu_info *info, int argc, char **argv)
{
    (void)info;
    for (int i = 0; i < argc; i++) {
        if (!take_argument(argv[i])) {
            fprintf(stderr, "count_instructions: cannot use %s\n", argv[i]);
            return -1;
        }
    }
    if (out == NULL) {
        fprintf(stderr, "count_instructions: out=FILE is missing\n");
        return -1;
    }
    qemu_plugin_register_vcpu_tb_trans_cb(id, translate);
    qemu_plugin_register_atexit_cb(id, at_exit, NULL);
    return 0;
}

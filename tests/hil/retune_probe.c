/* Sends another tuning to a running twin: retune_probe SUPERVISOR BLOCK PULSE CONFIG WHO
 *
 * SUPERVISOR is a process id; BLOCK and PULSE are descriptors of the supervisor's memory blocks. The
 * probe copies these descriptors, so it needs permission to trace that process.
 *
 * Prints "NUMBER TICK" after the twin has applied the tuning, or "NUMBER refused: WHY". Exit code 77
 * means that the permission is missing. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "firmware/base/os.h"
#include "firmware/config/config.h"
#include "firmware/live/live_blocks.h"

enum { SKIPPED = 77 };

static const tl_time PATIENCE = 20 * TL_SECOND;

static int number_of(const char *text) {
    return (int)strtol(text, NULL, 10);
}

/* Copies a descriptor of another process. */
static int take_descriptor(int process, int number) {
    int pidfd = (int)syscall(SYS_pidfd_open, process, 0);
    int taken = pidfd < 0 ? -1 : (int)syscall(SYS_pidfd_getfd, pidfd, number, 0);
    if (taken < 0) {
        exit(SKIPPED);
    }
    return taken;
}

static void *map(int process, const char *number, size_t size, tl_block *block) {
    tl_error error;
    if (tl_block_take(take_descriptor(process, number_of(number)), size, TL_BLOCK_THEY_WRITE, block, &error) != TL_OK) {
        (void)fprintf(stderr, "retune_probe: %s\n", error.text);
        exit(2);
    }
    return block->bytes;
}

static void fill(const char *path, const char *who, tl_config *config, tl_live_tuning_head *head) {
    tl_problems problems;
    tl_problems_init(&problems, path);
    if (tl_config_read(path, config, &problems.report) != TL_OK) {
        exit(2);
    }
    *head = (tl_live_tuning_head){.size = (uint32_t)config->size, .origin = "test", .why = "to see what it does"};
    (void)snprintf(head->who, sizeof head->who, "%s", who);
    memcpy(head->hash, config->hash, sizeof head->hash);
    tl_config_tuning(config, &head->tuning);
}

int main(int argc, char **argv) {
    tl_block tuning;
    tl_block live_status;
    tl_config config;
    tl_live_tuning_head head;
    tl_live_tuning_answer answer = {.number = 0};
    if (argc != 6) {
        return 2;
    }
    int process = number_of(argv[1]);
    tl_live_tuning *block = map(process, argv[2], sizeof *block, &tuning);
    const tl_live_twin_status *twin = map(process, argv[3], sizeof *twin, &live_status);
    fill(argv[4], argv[5], &config, &head);
    uint32_t number = tl_live_tuning_write(block, &head, config.text);
    tl_time until = tl_clock_now(NULL) + PATIENCE;
    while (!tl_live_tuning_answered(&twin->tuned, number, &answer) && tl_clock_now(NULL) < until) {
        tl_clock_sleep_until(tl_clock_now(NULL) + TL_SECOND / 1000);
    }
    if (answer.number != number) {
        (void)printf("%u silent\n", (unsigned)number);
    } else if (answer.refused != 0) {
        (void)printf("%u refused: %s\n", (unsigned)number, answer.why);
    } else {
        (void)printf("%u %lld\n", (unsigned)number, (long long)answer.tick);
    }
    tl_config_free(&config);
    return 0;
}

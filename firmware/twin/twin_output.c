/* What a process with FMUs prints: see twin_output.h. */
#include "firmware/twin/twin_output.h"

#include <poll.h>
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/relay.h"

enum { STACK = 256 * 1024 /* the supervisor locks it */, KINDS = 2 };

/* How much may be passed on still. */
typedef struct budget {
    int64_t left;
    tl_time looked;
} budget;

struct tl_twin_output {
    tl_twin_output_settings settings;
    pthread_t thread;
    int wake; /* eventfd */
    bool stop;
    bool output_ended;
    bool page_ended;
    bool page_is_too_long;
    tl_relay output;
    tl_relay page;
    /* in the relays' locks */
    budget budgets[KINDS]; /* an FMU's lines; those with a level */
    bool said_too_much;
    bool is_stuck; /* nobody reads our log */
    uint64_t left_out;
    uint64_t page_bytes;
};

/* ---- lines ---- */

static bool may_pass(budget *has, size_t bytes) {
    tl_time now = tl_clock_now(NULL);
    const double passed = tl_seconds(now - has->looked);
    if (passed > 0.001) {
        double left = (double)has->left + passed * TL_TWIN_OUTPUT_RATE;
        has->left = left > TL_TWIN_OUTPUT_MOST ? TL_TWIN_OUTPUT_MOST : (int64_t)left;
        has->looked = now;
    }
    bool may = has->left >= (int64_t)bytes;
    has->left -= may ? (int64_t)bytes : 0;
    return may;
}

static void say_too_much(tl_twin_output *self) {
    if (!self->said_too_much) {
        self->said_too_much = true;
        (void)tl_log_foreign(TL_LOG_WARNING,
                             "FMUs print more than is passed on: what they print from here on is left out",
                             TL_TWIN_OUTPUT_PATIENCE);
    }
}

/* A line without a level is an FMU's. */
static void pass_output(void *context, const char *line) {
    tl_twin_output *self = context;
    const char *text = NULL;
    int level = tl_log_level_of(line, &text);
    bool passed = may_pass(&self->budgets[level == TL_LOG_FOREIGN ? 0 : 1], strlen(line) + 1);
    if (!passed) {
        say_too_much(self);
    } else {
        int patience = self->is_stuck ? 0 : TL_TWIN_OUTPUT_PATIENCE;
        passed = tl_log_foreign(level, text, patience);
        self->is_stuck = !passed;
    }
    self->left_out += passed ? 0 : 1;
}

static void pass_page(void *context, const char *line) {
    tl_twin_output *self = context;
    self->page_bytes += strlen(line) + 1;
    if (self->page_bytes <= TL_TWIN_OUTPUT_PAGE_MOST) {
        (void)fprintf(self->settings.page_file, "%s\n", line);
    } else {
        __atomic_store_n(&self->page_is_too_long, true, __ATOMIC_RELEASE);
    }
}

static void say_left_out(const tl_twin_output *self) {
    if (self->left_out == 0) {
        return;
    }
    char text[128];
    (void)snprintf(text, sizeof text, "%llu lines that FMUs have printed were left out",
                   (unsigned long long)self->left_out);
    (void)tl_log_foreign(TL_LOG_WARNING, text, TL_TWIN_OUTPUT_PATIENCE);
}

/* ---- the thread ---- */

static void drain_one(tl_relay *relay, bool *ended) {
    if (!__atomic_load_n(ended, __ATOMIC_ACQUIRE) && !tl_relay_drain(relay)) {
        __atomic_store_n(ended, true, __ATOMIC_RELEASE);
    }
}

static void drain(tl_twin_output *self) {
    bool had_ended = __atomic_load_n(&self->output_ended, __ATOMIC_ACQUIRE);
    drain_one(&self->output, &self->output_ended);
    drain_one(&self->page, &self->page_ended);
    if (!had_ended && __atomic_load_n(&self->output_ended, __ATOMIC_ACQUIRE)) {
        self->settings.ended(self->settings.context);
    }
}

/* Ended pipes are left out: they would be ready for ever. */
static void wait_for_news(tl_twin_output *self) {
    enum { WAKE, OUTPUT, PAGE, WATCHED };
    bool output_ended = __atomic_load_n(&self->output_ended, __ATOMIC_ACQUIRE);
    bool page_ended = __atomic_load_n(&self->page_ended, __ATOMIC_ACQUIRE);
    struct pollfd watched[WATCHED] = {
        [WAKE] = {.fd = self->wake, .events = POLLIN},
        [OUTPUT] = {.fd = output_ended ? -1 : self->settings.output, .events = POLLIN},
        [PAGE] = {.fd = page_ended ? -1 : self->settings.page, .events = POLLIN},
    };
    uint64_t count = 0;
    (void)poll(watched, WATCHED, -1);
    (void)!read(self->wake, &count, sizeof count);
}

static void *pass_on(void *context) {
    tl_twin_output *self = context;
    bool stop = false;
    while (!stop) {
        wait_for_news(self);
        stop = __atomic_load_n(&self->stop, __ATOMIC_ACQUIRE);
        drain(self);
        self->settings.speak(self->settings.context);
    }
    return NULL;
}

/* ---- for others ---- */

/* Its thread does not run. */
static void release(tl_twin_output *self) {
    tl_relay_close(&self->output);
    if (self->settings.page >= 0) {
        tl_relay_close(&self->page);
    }
    say_left_out(self);
    (void)close(self->wake);
    free(self);
}

static tl_twin_output *make(const tl_twin_output_settings *settings) {
    tl_twin_output *made = calloc(1, sizeof *made);
    int wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (made == NULL || wake < 0) {
        if (wake >= 0) {
            (void)close(wake);
        }
        free(made);
        return NULL;
    }
    made->settings = *settings;
    made->wake = wake;
    made->page_ended = settings->page < 0;
    for (int i = 0; i < KINDS; i++) {
        made->budgets[i] = (budget){.left = TL_TWIN_OUTPUT_MOST, .looked = tl_clock_now(NULL)};
    }
    tl_relay_open(&made->output, settings->output, pass_output, made);
    if (settings->page >= 0) {
        tl_relay_open(&made->page, settings->page, pass_page, made);
    }
    return made;
}

tl_status tl_twin_output_start(const tl_twin_output_settings *settings, tl_twin_output **output, tl_error *error) {
    tl_twin_output *made = make(settings);
    if (made == NULL) {
        (void)close(settings->output);
        if (settings->page >= 0) {
            (void)close(settings->page);
        }
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory or descriptors to hear the process of the FMUs");
    }
    int result = tl_side_thread_start(&made->thread, STACK, pass_on, made);
    if (result != 0) {
        release(made);
        return tl_fail(error, TL_TRY_AGAIN, "no thread to hear the process of the FMUs: %s", strerror(result));
    }
    *output = made;
    return TL_OK;
}

void tl_twin_output_wake(const tl_twin_output *output) {
    const uint64_t one = 1;
    (void)!write(output->wake, &one, sizeof one);
}

void tl_twin_output_flush(tl_twin_output *output) {
    drain(output);
}

bool tl_twin_output_page_is_too_long(const tl_twin_output *output) {
    return __atomic_load_n(&output->page_is_too_long, __ATOMIC_ACQUIRE);
}

void tl_twin_output_stop(tl_twin_output *output) {
    if (output == NULL) {
        return;
    }
    __atomic_store_n(&output->stop, true, __ATOMIC_RELEASE);
    tl_twin_output_wake(output);
    (void)pthread_join(output->thread, NULL);
    drain(output);
    release(output);
}

/* See stage.h. */
#include "tests/support/stage.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/process/fmu_call.h"
#include "tests/support/message.h"
#include "tests/support/stderr_capture.h"

enum { LINE = 2048 };

static tl_stage *stage;

void tl_stage_pause_ms(long ms) {
    const struct timespec time = {.tv_sec = ms / 1000, .tv_nsec = ms % 1000 * 1000000};
    (void)nanosleep(&time, NULL);
}

static tl_stage_part *part_of(tl_member which) {
    bool is_other = stage->swapped && (which == TL_MEMBER_TWIN || which == TL_MEMBER_SHADOW);
    tl_member other = which == TL_MEMBER_TWIN ? TL_MEMBER_SHADOW : TL_MEMBER_TWIN;
    return &stage->parts[is_other ? other : which];
}

/* ---- children ---- */

static volatile sig_atomic_t ended_by;

static void note(int signal) {
    ended_by = signal;
}

static void beat(tl_thread_heartbeat *heartbeat) {
    tl_thread_heartbeat_beat(heartbeat);
    tl_stage_pause_ms(10);
    if (ended_by != 0) {
        tl_fmu_calls_note_end_request();
    }
}

static void be_well(tl_thread_heartbeat *heartbeat) {
    for (int i = 0; ended_by == 0 && i < 3000; i++) {
        beat(heartbeat);
    }
}

/* Ignores SIGTERM. */
static void be_well_and_deaf(tl_thread_heartbeat *heartbeat) {
    for (int i = 0; i < 3000; i++) {
        beat(heartbeat);
    }
}

static void hang(void) {
    for (;;) {
        tl_stage_pause_ms(1000);
    }
}

static void crash(void) {
    (void)signal(SIGSEGV, SIG_DFL); /* without a sanitizer's handler */
    (void)kill(getpid(), SIGSEGV);
}

static void spoil_name(tl_heartbeats *beats) {
    memset(beats->calls.names, '\n', sizeof beats->calls.names);
}

/* Misbehaviour of an FMU. */
static void misbehave(char what, tl_thread_heartbeat *heartbeat, tl_heartbeats *beats) {
    tl_fmu_call_begin(tl_fmu_calls_name("motor"), TL_FMU_DO_STEP);
    switch (what) {
    case 'n':
        spoil_name(beats);
        crash();
        break;
    case 'c':
        crash();
        break;
    case 'x':
        _exit(0);
    case 'y':
        _exit(65);
    case 'b':
        be_well_and_deaf(heartbeat);
        break;
    default:
        hang();
    }
}

static void call_fmus(void) {
    for (;;) {
        tl_fmu_call_begin(tl_fmu_calls_name("motor"), TL_FMU_DO_STEP);
        tl_stage_pause_ms(20);
        tl_fmu_call_end();
    }
}

/* Misbehaviour of the process itself. */
static void suffer(char what) {
    switch (what) {
    case 'h':
        hang();
        break;
    case 'r':
        call_fmus();
        break;
    case 't':
        (void)kill(getpid(), SIGTERM);
        break;
    case 'o':
        (void)kill(getpid(), SIGKILL);
        break;
    default:
        break;
    }
}

static int finish(char what, bool asked, tl_heartbeats *beats) {
    int code = what == '6' ? 65 : what == '7' || what == '8' ? 70 : 0;
    tl_end_cause why = asked ? TL_END_CAUSE_REQUESTED : TL_END_CAUSE_OVER;
    why = code == 0 ? why : what == '7' ? TL_END_CAUSE_FAILED : TL_END_CAUSE_REFUSED;
    tl_heartbeats_announce(beats, why, code);
    if (what == 'l') {
        crash();
    }
    return code;
}

static void be_deaf_at_first(void) {
    (void)signal(SIGTERM, SIG_IGN);
    tl_stage_pause_ms(500);
    (void)signal(SIGTERM, note);
}

static void begin_late(void) {
    (void)signal(SIGTERM, SIG_DFL);
    tl_stage_pause_ms(500);
    (void)signal(SIGTERM, note);
}

static int play(char what, tl_thread_heartbeat *heartbeat, tl_heartbeats *beats) {
    if (what == 'k') {
        crash();
    }
    if (what == 's') {
        hang();
    }
    if (what == 'd') {
        (void)signal(SIGTERM, SIG_DFL);
        be_well(heartbeat);
    }
    if (what == 'e') {
        begin_late();
    }
    if (what == 'i') {
        be_deaf_at_first();
    }
    if (strchr("68ya", what) == NULL) {
        tl_heartbeats_set_ready(beats);
    }
    if (strchr("cfxynb", what) != NULL) {
        misbehave(what, heartbeat, beats);
    }
    suffer(what);
    if (strchr("waei", what) != NULL) {
        be_well(heartbeat);
    }
    return finish(what, strchr("waeti", what) != NULL, beats);
}

unsigned tl_stage_processes_of(pid_t parent) {
    char path[64];
    unsigned count = 0;
    (void)snprintf(path, sizeof path, "/proc/%d/task/%d/children", (int)parent, (int)parent);
    FILE *file = fopen(path, "r");
    for (int letter = 0; file != NULL && letter != EOF; letter = getc(file)) {
        count += letter == ' ' ? 1 : 0; /* after each number */
    }
    if (file != NULL) {
        (void)fclose(file);
    }
    return count;
}

static int play_twin(tl_stage_part *played, const tl_start *start, char what) {
    int which = stage->starts++;
    if (what == '\0') {
        return 99; /* unplanned start */
    }
    stage->last = getpid();
    stage->hold[which] = start->hold;
    stage->again[which] = start->again;
    stage->failures[which] = start->failures;
    stage->unreadable[which] = start->unreadable;
    stage->processes[which] = tl_stage_processes_of(getppid());
    (void)snprintf(stage->reason[which], TL_RESTARTS_REASON, "%s", start->reason);
    return play(what, tl_thread_heartbeat_start(&played->beats, "cycle", TL_SECOND), &played->beats);
}

static int play_other(tl_stage_part *played, char what) {
    if (what == '\0') {
        return 99;
    }
    int code = play(what, tl_thread_heartbeat_start(&played->beats, "writer", TL_SECOND), &played->beats);
    played->order = __atomic_add_fetch(&stage->ends, 1, __ATOMIC_SEQ_CST);
    return code;
}

static void be_child(tl_member which, const tl_start *start, pid_t parent) {
    tl_stage_part *played = part_of(which);
    int number = played->starts++;
    char what = number < (int)strlen(played->plan) ? played->plan[number] : '\0';
    sigset_t none;
    (void)sigemptyset(&none);
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
    tl_fmu_calls_use(&played->beats.calls);
    (void)signal(SIGTERM, note);
    (void)signal(SIGINT, SIG_IGN);
    (void)sigprocmask(SIG_SETMASK, &none, NULL);
    if (getppid() == parent) {
        int code = which == TL_MEMBER_TWIN ? play_twin(played, start, what) : play_other(played, what);
        if (which == TL_MEMBER_TWIN) {
            played->order = __atomic_add_fetch(&stage->ends, 1, __ATOMIC_SEQ_CST);
        }
        _exit(code);
    }
    _exit(99);
}

/* ---- callbacks of the supervisor ---- */

static pid_t begin(void *context, tl_member which, const tl_start *start, tl_error *error) {
    (void)context;
    pid_t parent = getpid();
    tl_stage_part *begun = part_of(which);
    if (begun->starts < (int)strlen(begun->plan) && begun->plan[begun->starts] == '-') {
        begun->starts++;
        stage->starts += which == TL_MEMBER_TWIN ? 1 : 0;
        (void)tl_fail(error, TL_TRY_AGAIN, "no process is left");
        return 0;
    }
    (void)fflush(NULL);
    pid_t pid = fork();
    if (pid == 0) {
        be_child(which, start, parent);
    }
    begun->pid = pid;
    return pid > 0 ? pid : 0;
}

static uint64_t ended(void *context, tl_member which, bool by_others, char reason[TL_RESTARTS_REASON]) {
    tl_stage *on = context;
    on->was_killed_by_others = on->was_killed_by_others || by_others;
    part_of(which)->ends_reported++;
    on->ends_reported++;
    if (on->better[0] != '\0') {
        (void)snprintf(reason, TL_RESTARTS_REASON, "%s", on->better);
    }
    return on->blames;
}

static void on_event(void *context, const char *text) {
    tl_stage *on = context;
    (void)snprintf(on->event, sizeof on->event, "%s", text);
}

static tl_time damaged(void *context, tl_member which) {
    const tl_stage *on = context;
    return on->damaged[which];
}

static void read_orders(void *context, bool ends, tl_orders *orders) {
    (void)context;
    if (stage->play_on != NULL) {
        stage->play_on(ends, orders);
    }
    stage->swapped = stage->swapped != orders->swap;
}

/* ---- tests ---- */

tl_stage *tl_stage_open(const char *parent, const char *name) {
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    stage = mmap(NULL, sizeof *stage, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (stage == MAP_FAILED) {
        exit(1);
    }
    tl_scratch_make(&stage->scratch, parent, name);
    return stage;
}

int tl_stage_close(int failures) {
    return tl_scratch_finish(&stage->scratch, failures);
}

void tl_stage_empty(void) {
    const tl_stage emptied = {.settings = stage->settings, .scratch = stage->scratch};
    *stage = emptied;
}

void tl_stage_set(void) {
    tl_scratch_empty(&stage->scratch);
    tl_stage_empty();
    stage->settings = (tl_supervisor_settings){.has_duration = true,
                                               .begin = begin,
                                               .ended = ended,
                                               .report = on_event,
                                               .damaged = damaged,
                                               .read_orders = read_orders,
                                               .context = stage};
    (void)unsetenv("NOTIFY_SOCKET");
    (void)unsetenv("WATCHDOG_USEC");
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
}

void tl_stage_clear(void) {
    free(tl_stderr_capture_end());
}

void tl_stage_cast(tl_member which, const char *plan) {
    stage->parts[which].plan = plan;
    stage->settings.beats[which] = &stage->parts[which].beats;
}

void tl_stage_expect_code(const char *plan, int code) {
    tl_stage_cast(TL_MEMBER_TWIN, plan);
    TEST_ASSERT_EQUAL_INT(code, tl_supervise(&stage->settings, NULL));
    TEST_ASSERT_EQUAL_INT((int)strlen(plan), stage->starts);
}

void tl_stage_expect_said(const char *parts) {
    char *log = tl_stderr_capture_end();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_TRUE_MESSAGE(tl_test_has_line(log, parts), log);
    free(log);
}

void tl_stage_expect_report(const char *parts) {
    tl_stage_expect_said(parts);
    TL_EXPECT_PARTS(parts, stage->event);
}

void tl_stage_expect_silence(void) {
    char *log = tl_stderr_capture_end();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_STRING("", log);
    TEST_ASSERT_EQUAL_STRING("", stage->event);
    free(log);
}

int tl_stage_signal(const char *plan, int number, long after_ms, long again_ms) {
    tl_stage_cast(TL_MEMBER_TWIN, plan);
    pid_t self = getpid();
    pid_t killer = fork();
    if (killer == 0) {
        for (int i = 0; i < 1000 && __atomic_load_n(&stage->last, __ATOMIC_ACQUIRE) == 0; i++) {
            tl_stage_pause_ms(10);
        }
        tl_stage_pause_ms(after_ms);
        (void)kill(self, number);
        tl_stage_pause_ms(again_ms);
        if (again_ms != 0) {
            (void)kill(self, number);
        }
        _exit(0);
    }
    int code = tl_supervise(&stage->settings, NULL);
    TEST_ASSERT_EQUAL_INT(killer, waitpid(killer, NULL, 0));
    return code;
}

int tl_stage_signal_once(const char *plan, int number, long after_ms) {
    return tl_stage_signal(plan, number, after_ms, 0);
}

int tl_stage_end(const char *plan, int number, long after_ms) {
    int code = tl_stage_signal_once(plan, number, after_ms);
    TEST_ASSERT_EQUAL_INT(1, stage->starts);
    return code;
}

bool tl_stage_is_ready(tl_member part) {
    return stage->parts[part].pid != 0 && tl_heartbeats_is_ready(&stage->parts[part].beats);
}

bool tl_stage_has_died(tl_member part) {
    return stage->parts[part].ends_reported > 0;
}

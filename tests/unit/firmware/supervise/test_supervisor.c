/* The supervisor: real processes that hang, die, end and loop. What each of a member's does is one letter of its plan:
 *
 *   k  killed by a signal      h  becomes ready, then silent      s  silent before it is ready
 *   0  ready, ends with 0      7  ready, ends with 70             8  ends with 70 before it is ready
 *   6  ends with 65, never ready   w  ready, beats until SIGTERM   a  beats until SIGTERM, never ready
 *   -  cannot be started                       d  dies of SIGTERM before it is ready
 *   l  has done all, and crashes then              t  told to end by somebody else
 *   e  as w, and needs half a second to become ready, in which it dies of SIGTERM
 * and in an FMU, which nobody announces:
 *   c  crashes    f  hangs    x  ends with 0    y  ends with 65 before it is ready    n  crashes, and has spoilt its name
 *   r  a thread of ours hangs, while FMUs are called as ever      b  called while it is told to end, deaf
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/clock.h"
#include "firmware/process/fmu_call.h"
#include "firmware/supervise/service.h"
#include "firmware/supervise/supervisor.h"
#include "tests/support/scratch.h"
#include "tests/support/stderr_capture.h"

enum { MOST_STARTS = 32 };

/* Of one member. */
typedef struct part {
    const char *plan; /* NULL: there is no such member */
    int starts;
    int order; /* of its last end, among all */
    tl_heartbeats beats;
} part;

/* Shared by all processes of a test. The rest is of the twin. */
typedef struct stage {
    part parts[TL_MEMBERS];
    int ends;
    int starts;
    bool hold[MOST_STARTS];
    bool again[MOST_STARTS];
    char reason[MOST_STARTS][TL_RESTARTS_REASON];
    unsigned processes[MOST_STARTS]; /* of the supervisor, that are there, dead or alive */
    pid_t last;
    int told;                        /* ends of which the supervisor told */
    char better[TL_RESTARTS_REASON]; /* the reason that it is told instead */
    char event[256];                 /* the last one for the database */
    tl_time damaged[TL_MEMBERS];     /* what is said of each */
} stage;

static stage *shared;
static tl_scratch scratch;
static tl_supervisor_settings settings;

static void pause_ms(long ms) {
    const struct timespec time = {.tv_sec = ms / 1000, .tv_nsec = ms % 1000 * 1000000};
    (void)nanosleep(&time, NULL);
}

/* ---- children ---- */

static volatile sig_atomic_t told;

static void note(int signal) {
    told = signal;
}

static void be_well(tl_heart *heart) {
    for (int i = 0; told == 0 && i < 3000; i++) {
        tl_heart_beat(heart);
        pause_ms(10);
    }
}

/* Whenever it was told to end: at its start, too. */
static void be_well_and_deaf(tl_heart *heart) {
    for (int i = 0; i < 3000; i++) {
        tl_heart_beat(heart);
        pause_ms(10);
    }
}

static void hang(void) {
    for (;;) {
        pause_ms(1000);
    }
}

static void crash(void) {
    (void)signal(SIGSEGV, SIG_DFL); /* a sanitizer's is another end */
    (void)kill(getpid(), SIGSEGV);
}

static void spoil_name(tl_heartbeats *beats) {
    tl_fmu_calls *calls = tl_heartbeats_calls(beats);
    memset(calls->names, '\n', sizeof calls->names);
}

/* What an FMU does. */
static void misbehave(char what, tl_heart *heart, tl_heartbeats *beats) {
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
        be_well_and_deaf(heart);
        break;
    default:
        hang();
    }
}

static void call_fmus(void) {
    for (;;) {
        tl_fmu_call_begin(tl_fmu_calls_name("motor"), TL_FMU_DO_STEP);
        pause_ms(20);
        tl_fmu_call_end();
    }
}

/* What goes wrong in the process itself. */
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
    default:
        break;
    }
}

static int finish(char what, bool asked, tl_heartbeats *beats) {
    int code = what == '6' ? 65 : what == '7' || what == '8' ? 70 : 0;
    tl_farewell why = asked ? TL_FAREWELL_ASKED : TL_FAREWELL_OVER;
    why = code == 0 ? why : what == '7' ? TL_FAREWELL_FAILED : TL_FAREWELL_REFUSED;
    tl_heartbeats_announce(beats, why, code);
    if (what == 'l') {
        crash();
    }
    return code;
}

static void begin_late(void) {
    (void)signal(SIGTERM, SIG_DFL);
    pause_ms(500);
    (void)signal(SIGTERM, note);
}

static int play(char what, tl_heart *heart, tl_heartbeats *beats) {
    if (what == 'k') {
        crash();
    }
    if (what == 's') {
        hang();
    }
    if (what == 'd') {
        (void)signal(SIGTERM, SIG_DFL);
        be_well(heart);
    }
    if (what == 'e') {
        begin_late();
    }
    if (strchr("68ya", what) == NULL) {
        tl_heartbeats_set_ready(beats);
    }
    if (strchr("cfxynb", what) != NULL) {
        misbehave(what, heart, beats);
    }
    suffer(what);
    if (strchr("wae", what) != NULL) {
        be_well(heart);
    }
    return finish(what, strchr("waet", what) != NULL, beats);
}

static unsigned processes_of(pid_t parent) {
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

static int play_twin(const tl_start *start, char what) {
    int which = shared->starts++;
    if (what == '\0') {
        return 99; /* more starts than planned */
    }
    shared->last = getpid();
    shared->hold[which] = start->hold;
    shared->again[which] = start->again;
    shared->processes[which] = processes_of(getppid());
    (void)snprintf(shared->reason[which], TL_RESTARTS_REASON, "%s", start->restarts->reason);
    tl_heartbeats *beats = &shared->parts[TL_MEMBER_TWIN].beats;
    return play(what, tl_heart_begin(beats, "cycle", TL_SECOND), beats);
}

static int play_other(part *played, char what) {
    if (what == '\0') {
        return 99;
    }
    int code = play(what, tl_heart_begin(&played->beats, "writer", TL_SECOND), &played->beats);
    played->order = __atomic_add_fetch(&shared->ends, 1, __ATOMIC_SEQ_CST);
    return code;
}

static void be_child(tl_member which, const tl_start *start, pid_t parent) {
    part *played = &shared->parts[which];
    int number = played->starts++;
    char what = number < (int)strlen(played->plan) ? played->plan[number] : '\0';
    sigset_t none;
    (void)sigemptyset(&none);
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
    tl_fmu_calls_use(tl_heartbeats_calls(&played->beats));
    (void)signal(SIGTERM, note);
    (void)signal(SIGINT, SIG_IGN);
    (void)sigprocmask(SIG_SETMASK, &none, NULL);
    if (getppid() == parent) {
        int code = which == TL_MEMBER_TWIN ? play_twin(start, what) : play_other(played, what);
        if (which == TL_MEMBER_TWIN) {
            played->order = __atomic_add_fetch(&shared->ends, 1, __ATOMIC_SEQ_CST);
        }
        _exit(code);
    }
    _exit(99);
}

static pid_t begin(void *context, tl_member which, const tl_start *start) {
    (void)context;
    pid_t parent = getpid();
    part *begun = &shared->parts[which];
    if (begun->starts < (int)strlen(begun->plan) && begun->plan[begun->starts] == '-') {
        begun->starts++;
        shared->starts += which == TL_MEMBER_TWIN ? 1 : 0;
        return 0;
    }
    (void)fflush(NULL);
    pid_t pid = fork();
    if (pid == 0) {
        be_child(which, start, parent);
    }
    return pid > 0 ? pid : 0;
}

static void ended(void *context, tl_member which, char reason[TL_RESTARTS_REASON]) {
    stage *on = context;
    (void)which;
    on->told++;
    if (on->better[0] != '\0') {
        (void)snprintf(reason, TL_RESTARTS_REASON, "%s", on->better);
    }
}

static void tell(void *context, const char *text) {
    stage *on = context;
    (void)snprintf(on->event, sizeof on->event, "%s", text);
}

static tl_time damaged(void *context, tl_member which) {
    const stage *on = context;
    return on->damaged[which];
}

static bool look(void *context, bool ends) {
    (void)context;
    (void)ends;
    return false;
}

/* ---- tests ---- */

void setUp(void) {
    tl_scratch_empty(&scratch);
    memset(shared, 0, sizeof *shared);
    settings = (tl_supervisor_settings){
        .begin = begin, .ended = ended, .tell = tell, .damaged = damaged, .look = look, .context = shared};
    (void)unsetenv("NOTIFY_SOCKET");
    (void)unsetenv("WATCHDOG_USEC");
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
}

void tearDown(void) {
    free(tl_stderr_capture_end());
}

static void cast(tl_member which, const char *plan) {
    shared->parts[which].plan = plan;
    settings.beats[which] = &shared->parts[which].beats;
}

static void expect_code(const char *plan, int code) {
    cast(TL_MEMBER_TWIN, plan);
    TEST_ASSERT_EQUAL_INT(code, tl_supervise(&settings, NULL));
    TEST_ASSERT_EQUAL_INT((int)strlen(plan), shared->starts);
}

static void expect_said(const char *words) {
    char *log = tl_stderr_capture_end();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(log, words), log);
    free(log);
}

static void test_ends_with_its_child(void) {
    expect_code("0", 0);
    TEST_ASSERT_FALSE(shared->hold[0]);
    TEST_ASSERT_FALSE(shared->again[0]);
    TEST_ASSERT_EQUAL_STRING("it was told to", shared->reason[0]);
}

/* On the log, and as an event. */
static void expect_told(const char *words) {
    expect_said(words);
    TEST_ASSERT_EQUAL_STRING(words, shared->event);
}

static void test_a_bad_configuration_is_not_tried_again(void) {
    expect_code("6", 65);
}

/* Who starts it is told at once. */
static void test_what_never_ran_is_not_tried_again(void) {
    expect_code("8", 70);
}

/* An FMU that was removed meanwhile: it may come back, and if not, the plant is recorded at least. */
static void test_what_ran_and_cannot_begin_any_more(void) {
    expect_code("766660", 0);
    TEST_ASSERT_TRUE(shared->hold[5]);
    TEST_ASSERT_EQUAL_STRING("it ended with exit code 65", shared->reason[5]);
}

static void test_what_ran_is_tried_again(void) {
    expect_code("780", 0);
    TEST_ASSERT_TRUE(shared->again[1]);
    TEST_ASSERT_EQUAL_STRING("it ended with exit code 70", shared->reason[1]);
}

static void test_a_crash(void) {
    expect_code("k0", 0);
    TEST_ASSERT_EQUAL_STRING("it was ended by signal 11, Segmentation fault", shared->reason[1]);
    TEST_ASSERT_EQUAL_STRING("", shared->event); /* that reason is one */
}

/* Whoever started us may not have wanted to hear of its children. */
static void test_a_crash_where_children_are_ignored(void) {
    (void)signal(SIGCHLD, SIG_IGN);
    expect_code("k0", 0);
    TEST_ASSERT_EQUAL_STRING("it was ended by signal 11, Segmentation fault", shared->reason[1]);
}

/* The next child may look for what the dead one left, and must not find a process of its number. */
static void test_the_dead_are_reaped(void) {
    unsigned before = processes_of(getpid());
    expect_code("kkk0", 0);
    for (int i = 0; i < 4; i++) {
        TEST_ASSERT_EQUAL_UINT(before + 1, shared->processes[i]);
    }
}

/* Only what was announced is an orderly end, whatever the exit code says. */
static void test_an_fmu_that_ends_the_process(void) {
    expect_code("x0", 0);
    TEST_ASSERT_EQUAL_STRING("it ended unannounced, with exit code 0, in fmi2DoStep of motor", shared->reason[1]);
    TEST_ASSERT_TRUE(shared->again[1]);
}

static void test_an_fmu_that_ends_the_process_at_start(void) {
    expect_code("y0", 0);
    TEST_ASSERT_EQUAL_STRING("it ended unannounced, with exit code 65, in fmi2DoStep of motor", shared->reason[1]);
}

static void test_an_fmu_that_crashes(void) {
    expect_code("c0", 0);
    TEST_ASSERT_EQUAL_STRING("it was ended by signal 11, Segmentation fault, in fmi2DoStep of motor",
                             shared->reason[1]);
}

static void test_an_fmu_that_spoils_its_name(void) {
    expect_code("n0", 0);
    TEST_ASSERT_EQUAL_STRING_LEN("\\x0A\\x0A", strrchr(shared->reason[1], ' ') + 1, 8);
}

static void test_an_fmu_that_hangs(void) {
    const char *end = " s, in fmi2DoStep of motor";
    expect_code("f0", 0);
    size_t length = strlen(shared->reason[1]);
    TEST_ASSERT_EQUAL_STRING_LEN("it hung: \"cycle\" gave no sign of life for 1.", shared->reason[1], 44);
    TEST_ASSERT_TRUE(length > strlen(end));
    TEST_ASSERT_EQUAL_STRING(end, shared->reason[1] + length - strlen(end));
}

/* An FMU is not to blame for what hangs beside it. */
static void test_a_hang_beside_fmus(void) {
    expect_code("r0", 0);
    TEST_ASSERT_NULL(strstr(shared->reason[1], "fmi2"));
}

/* Nothing is lost, and nothing would be gained if it were done again. */
static void test_a_crash_after_all_was_done(void) {
    expect_code("l", 0);
    expect_said("the twin failed when all was done: it was ended by signal 11");
}

static void test_told_to_end_by_somebody_else(void) {
    expect_code("t0", 0);
    TEST_ASSERT_EQUAL_STRING("it was told to end, and not by its supervisor", shared->reason[1]);
}

static void test_a_hang(void) {
    expect_code("h0", 0);
    TEST_ASSERT_EQUAL_STRING_LEN("it hung: \"cycle\" gave no sign of life for 1.", shared->reason[1], 44);
}

static void test_a_hang_at_start(void) {
    expect_code("s0", 0);
}

static void test_a_loop_ends_in_safe_hold(void) {
    expect_code("khkkk0", 0);
    for (int i = 0; i < TL_RESTARTS_MOST; i++) {
        TEST_ASSERT_FALSE(shared->hold[i]);
    }
    TEST_ASSERT_TRUE(shared->hold[TL_RESTARTS_MOST]);
}

static void test_safe_hold_is_held(void) {
    expect_code("kkkkkk0", 0);
    TEST_ASSERT_TRUE(shared->hold[5]);
    TEST_ASSERT_TRUE(shared->hold[6]);
}

/* The account survives the supervisor: here one in a process of its own, which is killed. */
static void supervise_and_kill(void) {
    (void)fflush(NULL);
    pid_t supervisor = fork();
    if (supervisor == 0) {
        _exit(tl_supervise(&settings, NULL));
    }
    for (int i = 0; i < 1000 && __atomic_load_n(&shared->last, __ATOMIC_ACQUIRE) == 0; i++) {
        pause_ms(10);
    }
    pause_ms(100);
    TEST_ASSERT_EQUAL_INT(0, kill(supervisor, SIGKILL));
    TEST_ASSERT_EQUAL_INT(supervisor, waitpid(supervisor, NULL, 0));
}

static void test_a_killed_supervisor_takes_its_child_along(void) {
    cast(TL_MEMBER_TWIN, "w");
    settings.state = scratch.folder;
    supervise_and_kill();
    for (int i = 0; i < 500 && kill(shared->last, 0) == 0; i++) {
        pause_ms(10); /* until init has reaped it */
    }
    TEST_ASSERT_EQUAL_INT(-1, kill(shared->last, 0));
    memset(shared, 0, sizeof *shared);
    expect_code("0", 0);
    TEST_ASSERT_EQUAL_STRING("the supervisor was killed", shared->reason[0]);
    TEST_ASSERT_TRUE(shared->again[0]);
}

/* The exit code of a supervisor that gets the signal `after_ms` after the first start, and once more `again_ms` later; 0: it does not. */
static int supervise_and_signal(const char *plan, int number, long after_ms, long again_ms) {
    cast(TL_MEMBER_TWIN, plan);
    pid_t self = getpid();
    pid_t killer = fork();
    if (killer == 0) {
        for (int i = 0; i < 1000 && __atomic_load_n(&shared->last, __ATOMIC_ACQUIRE) == 0; i++) {
            pause_ms(10);
        }
        pause_ms(after_ms);
        (void)kill(self, number);
        pause_ms(again_ms);
        if (again_ms != 0) {
            (void)kill(self, number);
        }
        _exit(0);
    }
    int code = tl_supervise(&settings, NULL);
    TEST_ASSERT_EQUAL_INT(killer, waitpid(killer, NULL, 0));
    return code;
}

static int supervise_for(const char *plan, int number, long after_ms) {
    return supervise_and_signal(plan, number, after_ms, 0);
}

/* Not before everybody hangs. */
static int supervise_and_hurry(const char *plan) {
    tl_time begun = tl_clock_now(NULL);
    int code = supervise_and_signal(plan, SIGINT, 200, 1500);
    TEST_ASSERT_TRUE(tl_clock_now(NULL) - begun < 12 * TL_SECOND);
    return code;
}

static int supervise_and_tell(const char *plan, int number, long after_ms) {
    int code = supervise_for(plan, number, after_ms);
    TEST_ASSERT_EQUAL_INT(1, shared->starts);
    return code;
}

static void test_told_to_end(void) {
    TEST_ASSERT_EQUAL_INT(0, supervise_and_tell("w", SIGTERM, 200));
}

/* A child that does not end when it is told to is ended once it is silent; nobody begins a new one. */
static void test_told_to_end_while_it_hangs(void) {
    TEST_ASSERT_EQUAL_INT(75, supervise_and_tell("s", SIGINT, 0));
}

/* It hangs, and yet its heart beats. That it was killed is an orderly end of the supervisor all the same. Two signals at once, as of a terminal and a
 * shell, are one. */
static void test_told_to_end_and_deaf(void) {
    settings.state = scratch.folder;
    TEST_ASSERT_EQUAL_INT(75, supervise_and_signal("b", SIGTERM, 200, 300));
    TEST_ASSERT_EQUAL_INT(1, shared->starts);
    expect_told(
        "the twin failed when it was to end: it was told to end, and was still there 16 s later, in fmi2DoStep of "
        "motor");
    memset(shared, 0, sizeof *shared);
    expect_code("0", 0);
    TEST_ASSERT_EQUAL_STRING("it was told to", shared->reason[0]);
    TEST_ASSERT_FALSE(shared->again[0]);
}

/* ---- damage ---- */

static tl_time in_future(void) {
    return tl_clock_now(NULL) + 3600 * TL_SECOND;
}

/* Once: whoever says so for ever is not believed for ever. */
static void test_damage_is_a_failure(void) {
    settings.state = scratch.folder;
    shared->damaged[TL_MEMBER_TWIN] = in_future();
    TEST_ASSERT_EQUAL_INT(0, supervise_for("ww", SIGTERM, 1500));
    TEST_ASSERT_EQUAL_INT(2, shared->starts);
    TEST_ASSERT_EQUAL_STRING("it has destroyed its own memory: what it hands to the recorder cannot be read on",
                             shared->reason[1]);
}

/* Of the one before: found before this one was ready. */
static void test_damage_that_was_mended(void) {
    shared->damaged[TL_MEMBER_TWIN] = tl_clock_now(NULL);
    TEST_ASSERT_EQUAL_INT(0, supervise_and_tell("w", SIGTERM, 700));
}

static void test_damage_before_it_is_ready(void) {
    shared->damaged[TL_MEMBER_TWIN] = in_future();
    TEST_ASSERT_EQUAL_INT(0, supervise_and_tell("a", SIGTERM, 700));
}

static void test_damage_of_another_one(void) {
    cast(TL_MEMBER_IO, "ww");
    shared->damaged[TL_MEMBER_IO] = in_future();
    TEST_ASSERT_EQUAL_INT(0, supervise_and_tell("w", SIGTERM, 1500));
    TEST_ASSERT_EQUAL_INT(2, shared->parts[TL_MEMBER_IO].starts);
    expect_said("the reading of the plant failed: it has destroyed its own memory");
}

static void test_damage_alone(void) {
    settings.alone = true;
    shared->damaged[TL_MEMBER_TWIN] = in_future();
    expect_code("w", 70);
    expect_said("the twin failed: it has destroyed its own memory");
}

/* ---- alone ---- */

static void test_alone_a_failure_is_the_end(void) {
    settings.alone = true;
    expect_code("c", 70);
    expect_told("the twin failed: it was ended by signal 11, Segmentation fault, in fmi2DoStep of motor");
}

static void test_alone_what_it_says_itself_is_not_said_again(void) {
    settings.alone = true;
    expect_code("7", 70);
    char *log = tl_stderr_capture_end();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_STRING("", log);
    free(log);
}

/* Somebody may look at it with a debugger. */
static void test_alone_silence_is_allowed(void) {
    settings.alone = true;
    TEST_ASSERT_EQUAL_INT(75, supervise_and_tell("h", SIGTERM, 3000));
    expect_said("still there 16 s later");
}

static void test_alone_a_process_that_cannot_be_made(void) {
    settings.alone = true;
    expect_code("-", 75);
}

static void test_a_process_that_cannot_be_made_is_tried_again(void) {
    expect_code("-0", 0);
    TEST_ASSERT_EQUAL_STRING("no process could be made for it", shared->reason[1]);
}

/* Whoever presses Ctrl-C at once has done nothing wrong. */
static void test_told_to_end_before_it_could_hear_it(void) {
    cast(TL_MEMBER_RECORDER, "d");
    TEST_ASSERT_EQUAL_INT(0, supervise_and_tell("d", SIGTERM, 200));
    char *log = tl_stderr_capture_end();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_STRING("", log);
    free(log);
}

/* ---- io and recorder ---- */

static void test_all_end_in_order(void) {
    cast(TL_MEMBER_IO, "w");
    cast(TL_MEMBER_RECORDER, "w");
    TEST_ASSERT_EQUAL_INT(0, supervise_and_tell("w", SIGTERM, 200));
    TEST_ASSERT_EQUAL_INT(1, shared->parts[TL_MEMBER_TWIN].order);
    TEST_ASSERT_EQUAL_INT(2, shared->parts[TL_MEMBER_IO].order);
    TEST_ASSERT_EQUAL_INT(3, shared->parts[TL_MEMBER_RECORDER].order);
    TEST_ASSERT_EQUAL_INT(3, shared->told);
}

static void test_the_others_end_with_the_twin(void) {
    cast(TL_MEMBER_IO, "w");
    cast(TL_MEMBER_RECORDER, "w");
    expect_code("0", 0);
    TEST_ASSERT_EQUAL_INT(3, shared->ends);
}

/* More often than a twin may: and the twin goes on. */
static void test_they_are_begun_again_for_ever(void) {
    settings.state = scratch.folder;
    cast(TL_MEMBER_RECORDER, "kkkhkkw");
    TEST_ASSERT_EQUAL_INT(0, supervise_and_tell("w", SIGTERM, 9000));
    TEST_ASSERT_EQUAL_INT(7, shared->parts[TL_MEMBER_RECORDER].starts);
    expect_told("the recorder failed: it was ended by signal 11, Segmentation fault; another one is begun");
}

static void test_one_that_never_could_begin_ends_all(void) {
    cast(TL_MEMBER_IO, "6");
    cast(TL_MEMBER_RECORDER, "w");
    expect_code("a", 65);
    TEST_ASSERT_EQUAL_INT(3, shared->ends);
}

static void test_a_recorder_that_hangs_in_the_end_is_followed_by_one(void) {
    cast(TL_MEMBER_RECORDER, "be");
    cast(TL_MEMBER_IO, "w");
    expect_code("0", 0);
    expect_told(
        "the recorder failed when it was to end: it was told to end, and was still there 16 s later, in fmi2DoStep "
        "of motor; another one is begun");
    TEST_ASSERT_EQUAL_INT(2, shared->parts[TL_MEMBER_RECORDER].starts);
    TEST_ASSERT_EQUAL_INT(3, shared->parts[TL_MEMBER_RECORDER].order); /* in its own time */
}

/* Nobody waits for ever. */
static void test_recorders_that_cannot_keep_all(void) {
    cast(TL_MEMBER_RECORDER, "bb");
    TEST_ASSERT_EQUAL_INT(75, supervise_and_hurry("w"));
    TEST_ASSERT_EQUAL_INT(2, shared->parts[TL_MEMBER_RECORDER].starts);
    expect_told(
        "the recorder failed when it was to end: it was told to end, and was still there 2 s later, in fmi2DoStep "
        "of motor");
}

/* Whoever asks again waits for nobody. */
static void test_asked_again_to_end(void) {
    TEST_ASSERT_EQUAL_INT(75, supervise_and_hurry("b"));
    expect_said("asked again to end: who has not ended in 2 s is killed");
}

/* What it had to write still is in memory that outlives it. */
static void test_a_recorder_that_dies_in_the_end_is_begun_again(void) {
    cast(TL_MEMBER_RECORDER, "kkw");
    expect_code("0", 0);
    TEST_ASSERT_TRUE(shared->parts[TL_MEMBER_RECORDER].starts <= 3);
}

/* Who has killed it knows better. */
static void test_a_reason_can_be_bettered(void) {
    (void)snprintf(shared->better, sizeof shared->better, "it took too much memory");
    expect_code("k0", 0);
    TEST_ASSERT_EQUAL_STRING("it took too much memory", shared->reason[1]);
}

/* ---- a service manager that has no turn ---- */

static char notify_path[64];

/* A socket that holds nothing more, and that nobody reads. */
static int fill_notify_socket(void) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    (void)snprintf(notify_path, sizeof notify_path, "/tmp/twinlock-notify-%d", (int)getpid());
    (void)snprintf(address.sun_path, sizeof address.sun_path, "%s", notify_path);
    (void)unlink(notify_path);
    int socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
    int sender = socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
    TEST_ASSERT_EQUAL_INT(0, bind(socket_, (struct sockaddr *)&address, sizeof address));
    while (sendto(sender, "X", 1, 0, (struct sockaddr *)&address, sizeof address) == 1) {
    }
    (void)close(sender);
    TEST_ASSERT_EQUAL_INT(0, setenv("NOTIFY_SOCKET", notify_path, 1));
    return socket_;
}

/* It may be the hanging child that keeps it from having one. */
static void test_nobody_waits_for_the_service_manager(void) {
    int socket_ = fill_notify_socket();
    expect_code("h0", 0);
    (void)close(socket_);
    (void)unlink(notify_path);
}

static bool hears(int socket_, const char *wanted) {
    char text[TL_HEARTBEAT_STATUS] = "";
    for (int i = 0; i < 500; i++) {
        ssize_t size = recv(socket_, text, sizeof text - 1, 0);
        text[size < 0 ? 0 : size] = '\0';
        if (strcmp(text, wanted) == 0) {
            return true;
        }
        pause_ms(size < 0 ? 10 : 0);
    }
    return false;
}

/* A service that is never ready is ended by systemd. */
static void test_ready_is_told_until_it_is_heard(void) {
    int socket_ = fill_notify_socket();
    (void)setenv("WATCHDOG_USEC", "100000000", 1); /* who does not know that word was built without libsystemd */
    pid_t self = getpid();
    pid_t manager = fork();
    if (manager == 0) {
        pause_ms(500);
        bool heard = hears(socket_, "READY=1");
        (void)kill(self, SIGTERM);
        _exit(heard ? 0 : 1);
    }
    expect_code("w", 0);
    int how = 1;
    TEST_ASSERT_EQUAL_INT(manager, waitpid(manager, &how, 0));
    (void)close(socket_);
    (void)unlink(notify_path);
    if (tl_service_patience() == 0) {
        TEST_IGNORE_MESSAGE("built without libsystemd");
    }
    TEST_ASSERT_EQUAL_INT(0, how);
}

static void test_a_watchdog_that_is_none(void) {
    settings.watchdog = "/dev/null";
    settings.watchdog_s = 10;
    cast(TL_MEMBER_TWIN, "");
    TEST_ASSERT_EQUAL_INT(69, tl_supervise(&settings, NULL));
    TEST_ASSERT_EQUAL_INT(0, shared->starts);
}

static void test_a_folder_that_is_none(void) {
    settings.state = "/nowhere/state";
    cast(TL_MEMBER_TWIN, "");
    TEST_ASSERT_EQUAL_INT(65, tl_supervise(&settings, NULL));
    TEST_ASSERT_EQUAL_INT(0, shared->starts);
}

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_supervisor");
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    shared = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (shared == MAP_FAILED) {
        return 1;
    }
    RUN_TEST(test_ends_with_its_child);
    RUN_TEST(test_a_bad_configuration_is_not_tried_again);
    RUN_TEST(test_what_never_ran_is_not_tried_again);
    RUN_TEST(test_what_ran_and_cannot_begin_any_more);
    RUN_TEST(test_what_ran_is_tried_again);
    RUN_TEST(test_a_crash);
    RUN_TEST(test_a_crash_where_children_are_ignored);
    RUN_TEST(test_the_dead_are_reaped);
    RUN_TEST(test_an_fmu_that_ends_the_process);
    RUN_TEST(test_an_fmu_that_ends_the_process_at_start);
    RUN_TEST(test_an_fmu_that_crashes);
    RUN_TEST(test_an_fmu_that_spoils_its_name);
    RUN_TEST(test_an_fmu_that_hangs);
    RUN_TEST(test_a_hang_beside_fmus);
    RUN_TEST(test_a_crash_after_all_was_done);
    RUN_TEST(test_told_to_end_by_somebody_else);
    RUN_TEST(test_a_hang);
    RUN_TEST(test_a_hang_at_start);
    RUN_TEST(test_a_loop_ends_in_safe_hold);
    RUN_TEST(test_safe_hold_is_held);
    RUN_TEST(test_a_killed_supervisor_takes_its_child_along);
    RUN_TEST(test_told_to_end);
    RUN_TEST(test_told_to_end_while_it_hangs);
    RUN_TEST(test_told_to_end_and_deaf);
    RUN_TEST(test_damage_is_a_failure);
    RUN_TEST(test_damage_that_was_mended);
    RUN_TEST(test_damage_before_it_is_ready);
    RUN_TEST(test_damage_of_another_one);
    RUN_TEST(test_damage_alone);
    RUN_TEST(test_alone_a_failure_is_the_end);
    RUN_TEST(test_alone_what_it_says_itself_is_not_said_again);
    RUN_TEST(test_alone_silence_is_allowed);
    RUN_TEST(test_alone_a_process_that_cannot_be_made);
    RUN_TEST(test_a_process_that_cannot_be_made_is_tried_again);
    RUN_TEST(test_told_to_end_before_it_could_hear_it);
    RUN_TEST(test_all_end_in_order);
    RUN_TEST(test_the_others_end_with_the_twin);
    RUN_TEST(test_they_are_begun_again_for_ever);
    RUN_TEST(test_one_that_never_could_begin_ends_all);
    RUN_TEST(test_a_recorder_that_hangs_in_the_end_is_followed_by_one);
    RUN_TEST(test_recorders_that_cannot_keep_all);
    RUN_TEST(test_asked_again_to_end);
    RUN_TEST(test_a_recorder_that_dies_in_the_end_is_begun_again);
    RUN_TEST(test_a_reason_can_be_bettered);
    RUN_TEST(test_nobody_waits_for_the_service_manager);
    RUN_TEST(test_ready_is_told_until_it_is_heard);
    RUN_TEST(test_a_watchdog_that_is_none);
    RUN_TEST(test_a_folder_that_is_none);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}

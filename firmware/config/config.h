/* The configuration: one JSON file, checked completely, as plain data.
 *
 * Purpose: the border at which every user value is checked once. What it holds is described key by key in
 *          config/SPEC.md; names of variables are resolved later, by the twin, against the FMUs.
 * Errors:  all of one file at once, each with JSON path, line, what was found, what was expected, an example.
 *          ("line 12: found "0.1" (text), expected a number > 0, for example 0.1").
 * Owner:   tl_config owns all its memory, `where` and all other texts too; valid until tl_config_free(). It may be
 *          moved by assignment.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_CONFIG_CONFIG_H
#define TL_FIRMWARE_CONFIG_CONFIG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/signal.h"
#include "master/base/status.h"
#include "master/plan/plan.h"
#include "master/plan/tuning.h"

struct cJSON;

enum { TL_CONFIG_MAX_BYTES = 256 * 1024 };

/* A file or folder that is named in an array. */
typedef struct tl_config_name {
    const char *where; /* JSON path */
    const char *name;  /* as written; of libraries see tl_config_library_path(), else tl_config_file_path() */
} tl_config_name;

typedef struct tl_config_component {
    const char *where; /* JSON path */
    const char *name;
    const char *fmu;           /* as written; see tl_config_fmu_path */
    const char *sha256;        /* of that file, 64 digits; NULL: any will do */
    tl_config_name *libraries; /* shared ones that the FMU expects the program to have */
    size_t library_count;
    tl_config_name *reads; /* what it may read */
    size_t read_count;
    bool unconfined; /* it may do what the user can; and so may the FMUs that share its process */
    bool logging;    /* debug logging of the FMU */
    tl_rollback rollback;
    uint32_t replay_steps; /* from its beginning to where it can be led back by replay */
    tl_plan_set *set;
    size_t set_count;
    tl_keep keep;
} tl_config_component;

struct tl_driver; /* a row of drivers.h */

/* A device or stream that live signals come from. */
typedef struct tl_config_source {
    const char *where;
    const char *name;
    const struct tl_driver *driver; /* NULL in a configuration that is wrong only */
    double period_s;                /* default: step_s */
    void *settings;                 /* of the driver, as its row reads them: names of files and devices as written */
} tl_config_source;

/* What the name of a signal that shows another one's readings ends with: no name of a configuration does. */
#define TL_CONFIG_READING "@reading"

typedef struct tl_config_signal {
    tl_plan_signal plan;
    double minimum, maximum; /* ∓infinity: none */
    double stale_s;          /* 0: never stale */
    const char *column;      /* in a recording or CSV source; default: the signal's name */
    size_t source;           /* index of its live source; SIZE_MAX: none (recordings only) */
    void *channel;           /* of the source's driver, if there is a source */
    tl_time look_back;  /* a sample takes what was seen so long before its instant: see tl_plant_look (plant_input.h) */
    bool next;          /* there, or next */
    tl_between between; /* what it is where it is looked up between two readings */
    bool feeds;         /* it feeds an input of an FMU, or begins a stroke */
    bool is_matched;
    tl_between as_input, as_output; /* `between` as configured: of what feeds an input; of what is matched */
    tl_condition matched_condition; /* `condition` as configured */
    tl_time every;                  /* the longest time from one reading to the next, as a rule; ns, 0: not given */
    tl_condition condition;         /* what is done to its readings before it is looked up: where it is matched */
    size_t of;                      /* its own index; of a further look-up: that of the signal it is of */
    bool is_reading;                /* NAME@reading: shows the readings of another look-up as they come, */
    size_t shows;                   /* of this one */
} tl_config_signal;

/* `emulate`: what `twinlock plant` serves when it runs FMUs as the true plant. */
typedef struct tl_config_emulated {
    const char *where;
    const char *column; /* of the recording it makes; the signal's `column` in the configuration that reads it */
    const char *from;   /* "component.variable" or "plant.signal" */
    double noise;       /* standard deviation, in the variable's unit; 0: none */
} tl_config_emulated;

enum {
    TL_CONFIG_PARTICIPANTS = 16,
    TL_CONFIG_LONGEST_SHIFT = 1000 /* macro steps */
};

/* A chain of `delays`, and the density of its delay. */
typedef struct tl_config_chain {
    size_t length;
    size_t parts[TL_DELAY_CHAIN]; /* indices of participants */
    tl_delay_density density;
} tl_config_chain;

/* Two chains that begin with the same command; empty where the delay is given itself. */
typedef struct tl_config_pair {
    tl_config_chain plant, simulation;
    tl_time delay; /* by which the simulation's mode is later than the plant's: Δi, Δo */
} tl_config_pair;

/* `delays`: by how much plant and simulation are apart (eq. 4.14 to 4.16). */
typedef struct tl_config_delays {
    size_t participant_count;
    const char *names[TL_CONFIG_PARTICIPANTS];
    tl_delay_participant participants[TL_CONFIG_PARTICIPANTS];
    bool has_input, has_output;
    bool measure;  /* Δo is measured */
    tl_time range; /* measured delays that are used: −range … range; where it is measured */
    bool next;     /* where no reading lies at the instant of ŷ: the next one, else the newest before */
    tl_config_pair input, output;
    tl_time shift; /* the ŷ of y_j is looked up so long after t_j: Δi − Δo, and Δi is 0 where there is no `input` */
    tl_time wait; /* and so long may the next one take: the cycle by which ŷ is renewed; 0 where none is waited for */
} tl_config_delays;

typedef struct tl_config {
    const char *path;      /* as given */
    const char *directory; /* of path; relative files start here */
    const char *text;      /* the file's bytes, and a NUL behind them */
    size_t size;
    char hash[65]; /* SHA-256 of the text, hexadecimal */

    const char *name;
    tl_time step;     /* T_S, ns */
    tl_time duration; /* ns; 0: to the end of the recording, or until told to stop */

    tl_config_component *components;
    size_t component_count;
    tl_config_source *sources;
    size_t source_count;
    tl_config_signal *signals;
    size_t own_count;    /* those of the file, */
    size_t signal_count; /* and, once tl_config_use_lookups() was called, further look-ups too */
    size_t second_count; /* further look-ups, behind those of the file: first each NAME@match, then each NAME@reading */
    tl_plan_connection *connections;
    size_t connection_count;

    bool synchronise; /* false: adjust_count is 0 */
    tl_plan_adjust *adjust;
    size_t adjust_count;
    tl_plan_match *match;
    size_t match_count;
    tl_between *matched_between; /* of each match: last or line, */
    tl_condition *conditions;    /* and what is done to the readings before */
    const char **matched_as;     /* of each match: `to`, or the second look-up of that signal, "plant.NAME@match", */
    const char **reading_as;     /* and "plant.NAME@reading"; NULL: none */
    uint32_t prediction;
    tl_shape shape;
    tl_pairing measurements;
    tl_plan_event event;
    const char
        *algorithm; /* a name of master/solve/optimiser.h; NULL: secant for Real variables, boolean for Boolean ones */
    const char *fallback; /* the same; NULL: none */
    uint32_t stagnation;  /* 0: never */
    bool has_epsilon;     /* tolerances are its root, and none is given */
    double noise_floor;
    uint32_t verify_every;
    bool free_twin;
    double margin;
    tl_plan_saving saving;
    uint32_t saving_memory; /* MB that the FMUs' saved states may take */
    uint32_t budget_evaluations;
    tl_time budget_time; /* ns; 0: none but the step itself */

    const tl_config_delays *delays; /* NULL: none */
    tl_delay_lookup input_lookup,
        output_lookup; /* of what feeds an input, and of what is matched: for `delays`, and for what waits for a next reading */

    const char *recording_file;        /* NULL: none */
    const char *recording_time_column; /* default "time" */

    const char *record_file; /* NULL: the verb's default */
    int64_t record_max_bytes;
    tl_time record_commit;
    tl_time record_resume; /* a run goes on with one that ended at most so long ago; 0: with none */
    int64_t recording_run; /* of a database; 0: the last one. Set by the verb */

    int realtime_priority; /* SCHED_FIFO, 0: ordinary */
    bool realtime_lock_memory;
    tl_time realtime_hang; /* a cycle that is silent for longer hangs */

    tl_config_emulated *emulated;
    size_t emulated_count;
    double message_min_s, message_max_s; /* time between rows of an emulated recording; both 0: every step */

    tl_arena arena;     /* private, */
    struct cJSON *tree; /* as this: texts of the configuration point into both */
} tl_config;

/* Reads and checks the file. On failure every problem was reported and `config` is empty: nothing to free.
 * Errors: TL_BAD_DATA (also for a file that is absent or unreadable), TL_TRY_AGAIN where memory or the disk fails.
 * Syntax stops at its first error; else everything that is wrong is said, in the order of the sections. */
tl_status tl_config_read(const char *path, tl_config *config, tl_report *report);

/* The same for `size` bytes that are already in memory; relative file names start at the folder of `path`, which need
 * not exist. */
tl_status tl_config_read_text(const char *path, const char *text, size_t size, tl_config *config, tl_report *report);

/* For who takes samples as `delays` have them: from now on the second look-ups are signals as well. */
void tl_config_use_lookups(tl_config *config);

/* Steps until a prediction has outrun the measurements that its beginning has used, if a free twin is asked for; else 0. Two messages must have come, and a
 * filter must have had some time. */
uint32_t tl_config_free_twin_guard(const tl_config *config);

/* Whether FMUs of one component may do what the user can: then the whole process may. */
bool tl_config_is_unconfined(const tl_config *config);

/* Is its live value polled, so that a value may be read several times (Modbus)? */
bool tl_config_is_polled(const tl_config *config, const tl_config_signal *signal);

/* Of a signal that is polled: ns after a reading in which a poll that finds the same value is that reading again (plant_reader.h): until the next
 * one may be due, or half of `stale_s` is over, less a poll. 0: each poll is a reading. */
tl_time tl_config_repeats(const tl_config *config, const tl_config_signal *signal);

/* The index of the signal that "plant.NAME" names; SIZE_MAX: it names none. NULL is allowed. */
size_t tl_config_signal_of(const tl_config *config, const char *reference);

/* How much later than its own instant what is made of a measurement by its `condition` comes at most, if readings come as often as is said (every_s, else
 * step_s): ns. */
tl_time tl_config_condition_lag(const tl_config *config, size_t match);

/* The signal that shows the readings of a match as they come, "plant.NAME@reading"; NULL: the one that it is matched as; "": none, as there was no room.
 * Once further look-ups are used. */
const char *tl_config_reading_of(const tl_config *config, size_t match);

/* For who is the plant: it has no delays. Before the above. */
void tl_config_forget_delays(tl_config *config);

/* An empty (zeroed) configuration is allowed. */
void tl_config_free(tl_config *config);

/* What of it a running twin can take anew; and another such one in place of its own, which fits it (tl_tuning_fits()). Text and hash stay what was
 * read. */
void tl_config_tuning(const tl_config *config, tl_tuning *tuning);
void tl_config_retune(tl_config *config, const tl_tuning *tuning);

/* That of a text that was a configuration beside `own` once; its problems are not told. Checked, but for whether it fits. Errors: TL_BAD_DATA. */
tl_status tl_config_tuning_of(const tl_config *own, const char *text, tl_tuning *tuning, tl_error *error);

/* The line (from 1) of the item at a JSON path of this configuration, or of the innermost item around it that is
 * there ("plant.omega" for "plant.omega.unit" where no unit is given); 0 for "" and for a path that leads nowhere.
 * For problems found later, by the twin. */
size_t tl_config_line(const tl_config *config, const char *where);

/* Where an FMU is: beside the configuration, then in each folder of TWINLOCK_FMU_PATH (colon separated), then in
 * ../fmus and (where it is installed) ../lib/twinlock/fmus beside the program. False where it is nowhere; `path` then holds the first place looked at. An absolute
 * name is looked for only where it says. */
bool tl_config_fmu_path(const tl_config *config, const char *fmu, char *path, size_t size);

/* A file named in the configuration, relative to its folder. False, and "", where it does not fit. */
bool tl_config_file_path(const tl_config *config, const char *file, char *path, size_t size);

/* What to open a library by: a name without a slash stays as it is, for the loader to look up; any other is a file as
 * above. */
bool tl_config_library_path(const tl_config *config, const char *library, char *path, size_t size);

/* ---- The names of the modes of `synchronise.horizon.measurements`. At which tick a step is computed, the twin says: see tl_twin_facts.lead. */

/* By tl_pairing, then NULL: "lag", "ahead", "hold". */
extern const char *const tl_pairing_names[];

/* The mode of that name; TL_LAG where there is none. NULL is allowed. */
tl_pairing tl_pairing_named(const char *name);

/* ---- Problems of a configuration, told to a person: one log line each.
 *
 * Purpose: the tl_report that verbs hand down. A line reads "file: line N: JSON path: what was found, what was expected".
 */

typedef struct tl_problems {
    tl_report report;
    const char *file;
    const tl_config *config; /* NULL while the file is still being read */
} tl_problems;

void tl_problems_init(tl_problems *problems, const char *file);

/* The line that a problem's text begins with ("line 12: found …"), which is how the reader says it; *text then begins behind it. 0: none. */
size_t tl_problems_take_line(const char **text);

#endif

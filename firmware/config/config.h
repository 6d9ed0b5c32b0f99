/* Configuration: parses and validates one JSON file and provides it as plain data.
 *
 * Purpose: every user value is checked once, here. config/SPEC.md describes each key. The twin
 *          resolves names of variables later, against the FMUs.
 * Errors:  reports all problems of a file at once, each with JSON path, line, value found, value
 *          expected and an example ("line 12: found "0.1" (text), expected a number > 0, for
 *          example 0.1").
 * Owner:   tl_config owns all its memory, including `where` and all other texts. It is valid until
 *          tl_config_free() and may be moved by assignment.
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
#include "master/twin/account.h"

struct cJSON;

enum { TL_CONFIG_MAX_BYTES = 256 * 1024 };

/* A file or folder that an array names. */
typedef struct tl_config_name {
    const char *where; /* JSON path */
    const char *name;  /* as written; path: tl_config_library_path(), of others tl_config_file_path() */
} tl_config_name;

typedef struct tl_config_component {
    const char *where; /* JSON path */
    const char *name;
    const char *fmu;           /* as written; its path: tl_config_fmu_path() */
    const char *sha256;        /* expected SHA-256 of that file, 64 digits; NULL: not checked */
    tl_config_name *libraries; /* shared libraries that the FMU expects in the program */
    size_t library_count;
    tl_config_name *reads; /* files and folders that the FMU may read */
    size_t read_count;
    bool unconfined; /* the FMU has all rights of the user, and so do all FMUs in its process */
    bool logging;    /* debug logging of the FMU */
    tl_rollback rollback;
    uint32_t replay_steps; /* rollback by replay is possible up to this step, counted from the start */
    tl_plan_set *set;
    size_t set_count;
    tl_keep keep;
} tl_config_component;

struct tl_driver; /* a row of the table in drivers.h */

/* A device or stream that delivers live signals. */
typedef struct tl_config_source {
    const char *where;
    const char *name;
    const struct tl_driver *driver; /* NULL only in an invalid configuration */
    double period_s;                /* default: step_s */
    void *settings; /* the driver's settings as its row reads them; names of files and devices as written */
} tl_config_source;

/* Suffix of the name of a look-up that shows the readings of another one. A configuration cannot
 * define such a name. */
#define TL_CONFIG_READING "@reading"

typedef struct tl_config_signal {
    tl_plan_signal plan;
    double minimum, maximum; /* ∓infinity: no limit; in use: also those that FMUs declare */
    double below, above;     /* a value so far beyond them is moved to the limit; 0: none is */
    uint64_t items;          /* bit k: minimum + k is permitted; 0: all values */
    bool is_declared;        /* a limit in use is declared by an FMU */
    double stale_s;          /* 0: never stale */
    const char *column;      /* column in a recording or CSV source; default: the signal's name */
    size_t source;           /* index of its live source; SIZE_MAX: none, the signal comes from recordings only */
    void *channel;           /* of the source's driver; NULL without a source */
    tl_time look_back;       /* ns; how far a sample looks back: see tl_plant_lookup (plant_input.h) */
    bool next;               /* if there is no reading at that instant: take the next one */
    tl_between between;      /* value between two readings, when it is looked up */
    bool feeds;              /* the signal feeds an input of an FMU, or starts a stroke */
    bool is_matched;
    tl_between as_input, as_output; /* `between` as configured: for an input; for a matched output */
    tl_condition matched_condition; /* `condition` as configured */
    tl_time every;                  /* usual longest time between two readings, ns; 0: not given */
    tl_condition condition;         /* conditioning of its readings before the look-up, if this look-up is matched */
    size_t of;                      /* own index; for a further look-up: index of its signal */
    bool is_reading;                /* NAME@reading: shows the readings of another look-up as they come, */
    size_t shows;                   /* namely of this one */
} tl_config_signal;

/* `emulate`: values that `twinlock plant` serves when it simulates the true plant with FMUs. */
typedef struct tl_config_emulated {
    const char *where;
    const char *column; /* of the recording that it writes, as the `column` of a signal that reads it */
    const char *from;   /* "component.variable" or "plant.signal" */
    double noise;       /* standard deviation, in the variable's unit; 0: none */
} tl_config_emulated;

enum {
    TL_CONFIG_PARTICIPANTS = 16,
    TL_CONFIG_LONGEST_SHIFT = 1000 /* macro steps */
};

/* A chain of `delays`, and the probability density of its delay. */
typedef struct tl_config_chain {
    size_t length;
    size_t parts[TL_DELAY_CHAIN]; /* indices of participants */
    tl_delay_density density;
} tl_config_chain;

/* Two chains that start with the same command; empty if the delay itself is given. */
typedef struct tl_config_pair {
    tl_config_chain plant, simulation;
    tl_time delay; /* ns by which the simulation's mode is later than the plant's: Δi, Δo */
} tl_config_pair;

/* `delays`: time differences between plant and simulation (eq. 4.14 to 4.16). */
typedef struct tl_config_delays {
    size_t participant_count;
    const char *names[TL_CONFIG_PARTICIPANTS];
    tl_delay_participant participants[TL_CONFIG_PARTICIPANTS];
    bool has_input, has_output;
    bool measure;  /* Δo is measured */
    tl_time range; /* ns; if Δo is measured: delays from −range to range are used */
    bool next;     /* if there is no reading at the instant of ŷ: take the next one, else the newest before */
    tl_config_pair input, output;
    tl_time shift; /* ns; the ŷ of y_j is looked up this long after t_j: Δi − Δo; Δi is 0 without `input` */
    tl_time wait;  /* ns; longest wait for the next reading: the cycle in which ŷ is renewed; 0: no wait */
} tl_config_delays;

typedef struct tl_config {
    const char *path;      /* as given */
    const char *directory; /* of path; relative file names start here */
    const char *text;      /* bytes of the file, NUL-terminated */
    size_t size;
    char hash[65]; /* SHA-256 of the text, hexadecimal */

    const char *name;
    tl_time step;     /* T_S, ns */
    double start_s;   /* the FMUs' time at tick 0, s; NaN: not given */
    double stop_s;    /* their stop time, s; NaN: not given */
    tl_time duration; /* ns; 0: to the end of the recording, or until the run is stopped */

    tl_config_component *components;
    size_t component_count;
    tl_config_source *sources;
    size_t source_count;
    tl_config_signal *signals;
    size_t own_count;    /* signals in the file, */
    size_t signal_count; /* plus further look-ups after tl_config_use_lookups() */
    size_t second_count; /* further look-ups, after those of the file: all NAME@match, then all NAME@reading */
    tl_plan_connection *connections;
    size_t connection_count;

    bool synchronise; /* false: adjust_count is 0 */
    tl_plan_adjust *adjust;
    size_t adjust_count;
    tl_plan_match *match;
    size_t match_count;
    tl_between *matched_between; /* by match: last or line, */
    tl_condition *conditions;    /* and the conditioning of the readings before */
    const char **matched_as;     /* by match: `to`, or the second look-up of that signal, "plant.NAME@match", */
    const char **reading_as;     /* and "plant.NAME@reading"; NULL: none */
    uint32_t prediction;
    tl_shape shape;
    tl_pairing measurements;
    tl_plan_event event;
    const char *algorithm; /* solver (master/solve/optimiser.h); NULL: secant for Real, boolean for Boolean variables */
    const char *fallback;  /* name of a solver; NULL: none */
    uint32_t stagnation;   /* 0: never */
    bool has_epsilon;      /* `epsilon` is given: every tolerance is its square root, and no match has its own */
    double noise_floor;
    uint32_t verify_every;
    bool free_twin;
    double margin;
    tl_plan_saving saving;
    uint32_t saving_memory; /* MB for the FMUs' saved states */
    uint32_t budget_evaluations;
    tl_time budget_time; /* ns; 0: no limit but the step itself */

    const tl_config_delays *delays;              /* NULL: none */
    tl_delay_lookup input_lookup, output_lookup; /* of signals that feed an input; of matched signals */

    const char *recording_file;        /* NULL: none */
    const char *recording_time_column; /* default "time" */

    const char *record_file; /* NULL: the default of the command */
    int64_t record_max_bytes;
    tl_time record_commit;
    tl_time record_resume; /* ns; a run resumes an earlier one that ended at most this long ago; 0: never */
    int64_t recording_run; /* run of a database; 0: the last one. The command sets it */

    int realtime_priority; /* SCHED_FIFO priority; 0: ordinary scheduling */
    bool realtime_lock_memory;
    tl_time realtime_hang; /* ns; a cycle that reports nothing for longer counts as hanging */

    tl_config_emulated *emulated;
    size_t emulated_count;
    double message_min_s, message_max_s; /* s between two rows of an emulated recording; both 0: a row each step */

    tl_arena arena;     /* private; */
    struct cJSON *tree; /* private; texts of the configuration point into both */
} tl_config;

/* Reads and validates the file. On failure every problem was reported, and `config` is empty: there
 * is nothing to free.
 * Errors: TL_BAD_DATA (also if the file is absent or unreadable); TL_TRY_AGAIN if memory or the
 *         disk fails. A syntax error ends the parsing. Otherwise all problems are reported, in the
 *         order of the sections. */
tl_status tl_config_read(const char *path, tl_config *config, tl_report *report);

/* As tl_config_read(), for `size` bytes in memory. Relative file names start at the folder of
 * `path`, which need not exist. */
tl_status tl_config_read_text(const char *path, const char *text, size_t size, tl_config *config, tl_report *report);

/* Adds the limits that the inputs of FMUs declare, if narrower, to the signals that feed them. A
 * value at most a hundredth of the range beyond such a limit is noise; without a second
 * limit, a hundredth of the limit or of the nominal value. Signals of which no value would remain
 * stay as they are. `account`: of the built twin. */
void tl_config_use_bounds(tl_config *config, const tl_account *account);

/* Describes for people why a value of a signal is not good: "18.55 m is outside 0 … 5". `age`: of
 * its reading, ns. */
enum { TL_CONFIG_DESCRIPTION = 256 };
void tl_config_describe_quality(const tl_config *config, size_t signal, double value, tl_quality quality, tl_time age,
                                char text[TL_CONFIG_DESCRIPTION]);

/* What to do about it, for example "check scale, address, word order". */
const char *tl_config_quality_remedy(tl_quality quality);

/* Makes the further look-ups signals as well. For callers that take samples as `delays` require. */
void tl_config_use_lookups(tl_config *config);

/* Returns the steps after which a prediction no longer depends on the measurements at its start:
 * two messages and the memory of the filters, at least 2. Returns 0 if the free-run check is off.
 */
uint32_t tl_config_free_twin_guard(const tl_config *config);

/* Outputs of FMUs by the bits of tl_record.bad_outputs: those of `match`, then the sources of
 * `connect`. The first function returns NULL beyond the last one; the last bit may stand for
 * several. The second one returns true if the output is in the set, and no earlier one has its
 * name. */
enum { TL_CONFIG_OUTPUTS = 64 };

const char *tl_config_output_name(const tl_config *config, size_t output);
bool tl_config_is_bad_output(const tl_config *config, uint64_t bad_outputs, size_t output);

/* Returns true if a component is unconfined. Its FMUs have all rights of the user then, and so has
 * their whole process. */
bool tl_config_is_unconfined(const tl_config *config);

/* Returns true if the signal's source is polled (Modbus). A poll can return the same value several
 * times. */
bool tl_config_is_polled(const tl_config *config, const tl_config_signal *signal);

/* Time in ns after a reading in which an equal polled value counts as that reading again
 * (plant_reader.h). It is the shorter of `every_s` and half of `stale_s`, minus one poll period.
 * Returns 0 if every poll is a reading. */
tl_time tl_config_repeats(const tl_config *config, const tl_config_signal *signal);

/* Returns the index of the signal that "plant.NAME" names, or SIZE_MAX if there is none.
 * `reference` may be NULL. */
size_t tl_config_signal_of(const tl_config *config, const char *reference);

/* Longest delay in ns that `condition` adds to a measurement, if readings come every every_s
 * (default: step_s). */
tl_time tl_config_condition_lag(const tl_config *config, size_t match);

/* Returns the look-up that shows the readings of a match as they come, "plant.NAME@reading".
 * Returns NULL if the matched signal itself shows them, and "" if there was no room for such a
 * look-up. Call it after tl_config_use_lookups(). */
const char *tl_config_reading_of(const tl_config *config, size_t match);

/* Removes all delays, look-ups and conditions. For a process that emulates the plant. Call it
 * before the functions above. */
void tl_config_forget_delays(tl_config *config);

/* Frees the configuration. A zeroed one is allowed. */
void tl_config_free(tl_config *config);

/* The first function returns the values that a running twin can change. The second one sets them
 * from a tuning that fits (tl_tuning_fits()). Text and hash remain those of the file. */
void tl_config_tuning(const tl_config *config, tl_tuning *tuning);
void tl_config_retune(tl_config *config, const tl_tuning *tuning);

/* Reads the tuning from the text of an earlier configuration of the same path as `own`. Its
 * problems are not reported. Checks the tuning, but not whether it fits. Errors: TL_BAD_DATA. */
tl_status tl_config_tuning_of(const tl_config *own, const char *text, tl_tuning *tuning, tl_error *error);

/* Returns the line (from 1) of the item at a JSON path of this configuration. If there is no such
 * item, returns the line of the innermost item around it ("plant.omega" for "plant.omega.unit"
 * without a unit). Returns 0 for "" and for a path without any existing part. For problems that the
 * twin finds later. */
size_t tl_config_line(const tl_config *config, const char *where);

/* Finds an FMU: beside the configuration, then in each folder of TWINLOCK_FMU_PATH (separated by
 *               colons), then in ../fmus and in ../lib/twinlock/fmus (installed) beside the
 *               program. An absolute name is tried only as written. Returns false if it is not
 *               found; `path` is then the first path that was tried. */
bool tl_config_fmu_path(const tl_config *config, const char *fmu, char *path, size_t size);

/* Path of a file that the configuration names, relative to its folder. Returns false, and "", if it
 * does not fit. */
bool tl_config_file_path(const tl_config *config, const char *file, char *path, size_t size);

/* Name by which a library is opened. The loader searches a name without a slash; any other name is
 * a file as above. */
bool tl_config_library_path(const tl_config *config, const char *library, char *path, size_t size);

/* ---- Names of the modes of `synchronise.horizon.measurements`. The tick at which a step is
 * computed: tl_twin_facts.lead. */

/* By tl_pairing, ended by NULL: "lag", "ahead", "hold". */
extern const char *const tl_pairing_names[];

/* Returns the mode of that name, or TL_LAG if there is none. NULL is allowed. */
tl_pairing tl_pairing_named(const char *name);

/* ---- Problems of a configuration, logged for the user: one line each.
 *
 * Purpose: the tl_report that commands pass on. A line reads "file: line N: JSON path: what was
 *          found, what was expected".
 */

typedef struct tl_problems {
    tl_report report;
    const char *file;
    const tl_config *config; /* NULL while the file is being read */
} tl_problems;

void tl_problems_init(tl_problems *problems, const char *file);

/* Parses the line number with which a problem's text may start ("line 12: found …") and moves *text
 * after it. Returns 0 if there is none. */
size_t tl_problems_take_line(const char **text);

#endif

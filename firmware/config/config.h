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
    const char *name;  /* as written; path of a library: tl_config_library_path(), else tl_config_file_path() */
} tl_config_name;

typedef struct tl_config_component {
    const char *where; /* JSON path */
    const char *name;
    const char *fmu;           /* as written; its path: tl_config_fmu_path() */
    const char *sha256;        /* expected SHA-256 of that file, 64 digits; NULL: not checked */
    tl_config_name *libraries; /* shared libraries that are opened before the FMU (fmu_binary.h) */
    size_t library_count;
    tl_config_name *reads; /* files and folders that the FMU may read */
    size_t read_count;
    bool unconfined; /* the FMU has all rights of the user, and so do all FMUs in its process */
    bool logging;    /* debug logging of the FMU */
    tl_rollback rollback;
    uint32_t replay_steps; /* rollback by replay is possible up to this step, counted from the FMU's start */
    tl_plan_set *set;      /* values that are set before the FMU is initialised */
    size_t set_count;
    tl_keep keep; /* what is saved of each executed step (plan.h) */
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

/* Suffix of the name of a look-up. A look-up takes one value from the readings of a signal, for a
 * given instant (tl_plant_lookup in plant_input.h). Each signal of the file is one look-up. A
 * signal may have further ones: NAME@match if it is matched and also feeds an input; NAME@reading
 * if it is matched with a condition or interpolation. NAME@reading shows the readings unchanged.
 * The file cannot define such names. */
#define TL_CONFIG_READING "@reading"

typedef struct tl_config_signal {
    tl_plan_signal plan;
    double minimum, maximum; /* ∓infinity: no limit; FMUs may narrow them: tl_config_use_bounds() */
    double below, above;     /* a value at most this far beyond a limit is moved to it; 0: no value is moved */
    uint64_t items;          /* bit k: minimum + k is permitted; 0: all values */
    bool is_declared;        /* a limit in use is declared by an FMU */
    double stale_s;          /* a reading older than this is stale; 0: never */
    const char *column;      /* column in a recording or CSV source; default: the signal's name */
    size_t source;           /* index of its live source; SIZE_MAX: none, the signal comes from recordings only */
    void *channel;           /* settings of this signal for the driver of its source; NULL without a source */
    tl_time look_back;       /* ns; the value is taken this long before the instant of the sample */
    bool next;               /* if there is no reading at that instant: prefer the next one to the one before */
    tl_between between;      /* how a value between two readings is computed */
    bool feeds;              /* the signal feeds an input of an FMU, or starts an event horizon (tl_plan_event) */
    bool is_matched;
    tl_between as_input, as_output; /* `between` as configured: for an input; for a matched output */
    tl_condition matched_condition; /* `condition` as configured */
    tl_time every;                  /* ns; longest usual time between two readings; 0: not given */
    tl_condition condition;         /* in use: conditions readings before a matched look-up; all 0: none */
    size_t of;                      /* index of its signal in the file; own index if it is no further look-up */
    bool is_reading;                /* this is NAME@reading: it shows the unchanged readings of another look-up, */
    size_t shows;                   /* which has this index */
} tl_config_signal;

enum { TL_CONFIG_WORDS = 48 }; /* bytes with the NUL */

/* The user's words for an adjusted variable or a matched signal, in findings. */
typedef struct tl_config_words {
    const char *name; /* "component.variable" or "plant.signal" */
    const char *words;
} tl_config_words;

/* Limits of the correction Δu of an adjusted variable, in its unit. */
typedef struct tl_config_alarm {
    size_t adjust;       /* index of the variable */
    double above, below; /* ±infinity: no limit */
    tl_time lasts;       /* ns over which Δu is averaged */
} tl_config_alarm;

/* `emulate`: values that `twinlock plant` serves when it simulates the true plant with FMUs. */
typedef struct tl_config_emulated {
    const char *where;
    const char *column; /* its column in the written recording; a signal that reads it has this `column` */
    const char *from;   /* "component.variable" or "plant.signal" */
    double noise;       /* standard deviation, in the variable's unit; 0: none */
} tl_config_emulated;

enum {
    TL_CONFIG_PARTICIPANTS = 16,
    TL_CONFIG_LONGEST_SHIFT = 1000 /* macro steps */
};

/* A chain of `delays`: the participants that pass a signal on, in their order, and the probability
 * density of the delay of the chain. */
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
    tl_time wait;  /* ns; longest wait for the next reading: the cycle in which the plant renews ŷ; 0: no wait */
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
    tl_between *matched_between; /* by index of the match: last or line, */
    tl_condition *conditions;    /* and the conditioning of readings before the look-up */
    const char **matched_as;     /* by match: `to`, or the further look-up of that signal, "plant.NAME@match", */
    const char **reading_as;     /* and "plant.NAME@reading"; NULL: none */
    uint32_t prediction;         /* T_P, macro steps */
    tl_shape shape;
    tl_pairing measurements;
    tl_plan_event event;
    const char *algorithm; /* solver (master/solve/optimiser.h); NULL: secant for Real, boolean for Boolean variables */
    const char *fallback;  /* name of a solver; NULL: none */
    uint32_t stagnation;   /* evaluations without progress that stop a solver; 0: never */
    bool has_epsilon;      /* `epsilon` is given: every tolerance is its square root, and no match has its own */
    double noise_floor;    /* as in tl_plan (plan.h) */
    uint32_t verify_every; /* as in tl_plan */
    uint32_t released_steps; /* as in tl_plan */
    bool free_twin;          /* the free-run check is on */
    bool rests;              /* u may rest at nominal if the corrections do harm (monitor/lock_monitor.h) */
    double margin;           /* as in tl_plan */
    tl_plan_saving saving;
    uint32_t saving_memory; /* MiB for the saved states of all FMUs */
    uint32_t budget_evaluations;
    tl_time budget_time; /* ns; 0: no limit but the step itself */

    const tl_config_delays *delays;              /* NULL: none */
    tl_delay_lookup input_lookup, output_lookup; /* look-back of signals that feed an input; of matched signals */

    const char *recording_file;        /* NULL: none */
    const char *recording_time_column; /* default "time" */

    const char *record_file; /* NULL: the default of the command */
    int64_t record_max_bytes;
    tl_time record_commit;
    tl_time record_resume; /* ns; a run resumes an earlier one that ended at most this long ago; 0: never */
    /* The command sets both. */
    int64_t recording_run;    /* run of a database; 0: the last one */
    int64_t recording_follow; /* not 0: follow u as recorded, from the newest checkpoint before this tick */

    double false_alarms_per_year; /* of findings (change_detector.h) */
    tl_time detect_learn;         /* ns; until changes are reported */
    tl_time detect_cycle;         /* longest recurring cycle of the plant, ns; 0: not known */
    tl_config_words *says;
    size_t says_count;
    tl_config_alarm *alarms;
    size_t alarm_count;

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

/* Narrows the limits of each signal that feeds FMU inputs to the limits that these inputs declare.
 * A value beyond such a limit by at most 1 % of the range counts as noise and is moved to the
 * limit. Without a second limit, it is 1 % of the limit or of the nominal value, whichever is
 * larger. A signal keeps its limits if no value would remain. `account`: of the built twin. */
void tl_config_use_bounds(tl_config *config, const tl_account *account);

/* Writes for the user why a value of a signal is not good: "18.55 m is outside 0 … 5". `age`: age
 * of its reading, ns. */
enum { TL_CONFIG_DESCRIPTION = 256 };
void tl_config_describe_quality(const tl_config *config, size_t signal, double value, tl_quality quality, tl_time age,
                                char text[TL_CONFIG_DESCRIPTION]);

/* Text of an event: "saving: motor states, drive none". The first function writes what components
 * with "keep": "auto" keep, from component `first` on, as far as there is room for it. `unsaved` as
 * in tl_twin_unsaved(). Returns the next component. The second function returns false if the text
 * is not of that kind; else it sets the bits of components that keep none. */
enum { TL_CONFIG_KEEP_TEXT = 224 };
size_t tl_config_write_keep(const tl_config *config, uint64_t unsaved, size_t first, char text[TL_CONFIG_KEEP_TEXT]);
bool tl_config_read_keep(const tl_config *config, const char *text, uint64_t *unsaved);

/* Returns what the user can do about this quality, for example "check scale, address, word
 * order". */
const char *tl_config_quality_remedy(tl_quality quality);

/* Includes the further look-ups in signal_count. Call it before samples are taken with delays,
 * interpolation or conditions. */
void tl_config_use_lookups(tl_config *config);

/* Returns the number of steps after which a prediction no longer depends on the measurements at its
 * start: the time of two messages plus the memory of the filters, at least 2 steps. Returns 0 if
 * the free-run check is off. */
uint32_t tl_config_free_twin_guard(const tl_config *config);

/* Outputs of FMUs by bit number in tl_record.bad_outputs: first those of `match`, then the sources
 * of `connect`. The last bit (63) stands for all further outputs. The first function returns the
 * name, or NULL if there is no such output. The second one returns true if the bit is set and no
 * output with a lower number has the same name. */
enum { TL_CONFIG_OUTPUTS = 64 };

const char *tl_config_output_name(const tl_config *config, size_t output);
bool tl_config_is_bad_output(const tl_config *config, uint64_t bad_outputs, size_t output);

/* Returns true if a component is unconfined. Its FMUs have all rights of the user then, and so has
 * their whole process. */
bool tl_config_is_unconfined(const tl_config *config);

/* Returns true if the signal's source is polled (Modbus). A poll can return the same value several
 * times. */
bool tl_config_is_polled(const tl_config *config, const tl_config_signal *signal);

/* Returns the time in ns after a reading in which an equal polled value is the same reading
 * (plant_reader.h). It is the shorter of `every_s` and half of `stale_s`, minus one poll period.
 * Returns 0 if every poll is a reading. */
tl_time tl_config_repeats(const tl_config *config, const tl_config_signal *signal);

/* Returns the time in ns in which the configuration expects a reading of the signal: its `every_s`,
 * or the period of its source if that is polled. Returns 0 if it expects no rate, and for a further
 * look-up of a signal. */
tl_time tl_config_interval(const tl_config *config, const tl_config_signal *signal);

/* Returns the index of the signal that "plant.NAME" names, or SIZE_MAX if there is none.
 * `reference` may be NULL. */
size_t tl_config_signal_of(const tl_config *config, const char *reference);

/* Returns the longest delay in ns that the condition of this match adds to a measurement. It
 * assumes one reading every every_s (default: step_s). */
tl_time tl_config_condition_lag(const tl_config *config, size_t match);

/* Returns the name of the look-up that shows the unchanged readings of a match,
 * "plant.NAME@reading". Returns NULL if the matched look-up itself shows them, and "" if there was
 * no room for such a look-up. Call it after tl_config_use_lookups(). */
const char *tl_config_reading_of(const tl_config *config, size_t match);

/* How Δo is measured. REPORTED: with released twins, and not used. */
typedef enum tl_config_measured { TL_DELAY_NOT_MEASURED, TL_DELAY_REPORTED, TL_DELAY_USED } tl_config_measured;
tl_config_measured tl_config_measures_delay(const tl_config *config);

/* Removes all delays, further look-ups and conditions. For a process that emulates the plant. Call
 * it before tl_config_use_lookups(). */
void tl_config_forget_delays(tl_config *config);

/* Frees the configuration. A zeroed one is allowed. */
void tl_config_free(tl_config *config);

/* The first function returns the values that a running twin can change. The second one sets them
 * from a tuning that fits (tl_tuning_fits()). Text and hash remain those of the file. */
void tl_config_tuning(const tl_config *config, tl_tuning *tuning);
void tl_config_retune(tl_config *config, const tl_tuning *tuning);

/* Reads the tuning from `text`, an earlier configuration. Relative file names in it start at the
 * folder of `own`. Its problems are not reported. Checks the tuning, but not whether it fits.
 * Errors: TL_BAD_DATA. */
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

/* Writes the path of a file that the configuration names; a relative name starts at its folder.
 * Returns false, and "" in `path`, if the path does not fit. */
bool tl_config_file_path(const tl_config *config, const char *file, char *path, size_t size);

/* Writes the name by which a library is opened. The loader searches for a name without a slash. Any
 * other name is a file, as for tl_config_file_path(). */
bool tl_config_library_path(const tl_config *config, const char *library, char *path, size_t size);

/* ---- Names of the modes of `synchronise.horizon.measurements`. The mode decides at which tick a
 * step is computed: see tl_twin_facts.lead. */

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

/* `file`: name for the log; it must outlive `problems`. */
void tl_problems_init(tl_problems *problems, const char *file);

/* Parses the line number with which a problem's text may start ("line 12: found …") and moves *text
 * after it. Returns 0 if there is none. */
size_t tl_problems_take_line(const char **text);

#endif

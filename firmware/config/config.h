/* Configuration: parses and validates one JSON file and provides it as plain data.
 *
 * Purpose: checks every user value once. docs/reference/configuration.md describes each key. The
 *          twin resolves names of variables later, against the FMUs.
 * Errors:  reports all problems of a file at once, each with its JSON path: line 12: found "0.1"
 *          (text), expected a number > 0, for example 0.1.
 * Owner:   tl_config owns all its memory, including `where` and all other texts. It is valid until
 *          tl_config_free() and may be moved by assignment.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_CONFIG_CONFIG_H
#define TL_FIRMWARE_CONFIG_CONFIG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/json.h"
#include "master/base/arena.h"
#include "master/base/signal.h"
#include "master/base/status.h"
#include "master/plan/plan.h"
#include "master/plan/tuning.h"
#include "master/twin/account.h"

struct cJSON;

enum { TL_CONFIG_MAX_BYTES = 256 * 1024 }; /* largest file */

/* An element of `libraries` (a library) or `read` (a file or folder) of a component. */
typedef struct tl_config_name {
    const char *where; /* JSON path */
    const char *name;  /* as written; path of a library: tl_config_library_path(), else tl_config_file_path() */
} tl_config_name;

typedef struct tl_config_component {
    const char *where; /* JSON path */
    const char *name;
    const char *fmu;           /* as written; its path: tl_config_fmu_path() */
    const char *sha256;        /* expected SHA-256 of that file, 64 hex digits; NULL: not checked */
    tl_config_name *libraries; /* shared libraries that are opened before the FMU (fmu_binary.h) */
    size_t library_count;
    tl_config_name *reads; /* files and folders that the FMU may read */
    size_t read_count;
    bool unconfined; /* the FMU has all rights of the user, and so do all FMUs in its process */
    bool logging;    /* debug logging of the FMU */
    tl_rollback rollback;
    uint32_t replay_steps; /* steps after the FMU's start in which replay can roll back */
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
    double period_s;                /* s; fixed by the driver, or configured (default: step_s) */
    void *settings;                 /* filled by driver->read_source(); paths are as written */
} tl_config_source;

/* A look-up takes one value from the readings of a signal, for a given instant (tl_plant_lookup in
 * plant_input.h). Each signal of the file is one look-up. With delays, conditions or interpolation,
 * a signal that is matched and also feeds an input has a second one, NAME@match. A matched look-up
 * with a condition or interpolation has a further one for its unchanged readings, NAME@reading, if
 * there is room (TL_MAX_SIGNALS). The file cannot define such names. */
#define TL_CONFIG_READING "@reading"

typedef struct tl_config_signal {
    tl_plan_signal plan;
    double minimum, maximum; /* ∓infinity: no limit; tl_config_use_bounds() may narrow them */
    double below, above;     /* ≥ 0: a value at most this far beyond the limit is moved to it */
    uint64_t items;          /* bit k: minimum + k is permitted; 0: all values */
    bool is_declared;        /* an FMU declares a limit that is in use, or `items` */
    double stale_s;          /* s; a reading older than this is stale; 0: never */
    const char *column;      /* column in a recording or CSV source; default: the signal's name */
    double scale, offset;    /* of the column: value = cell·scale + offset */
    size_t source;           /* index of its live source; SIZE_MAX: only in recordings */
    void *channel;           /* filled by driver->read_signal(); NULL: no key of a driver */
    tl_time look_back;       /* ns, ≥ 0: look-up this long before the sample's instant */
    bool next;               /* between two readings: the next one; false: the one before */
    tl_between between;      /* in use: the value between two readings */
    bool feeds;              /* feeds an input of an FMU, or is the start of tl_plan_event */
    bool is_matched;
    tl_between as_input, as_output; /* `between` as configured, for an input and for a match */
    tl_condition matched_condition; /* as configured, plus the default rejection of outliers */
    tl_time every;                  /* ns; longest usual time between two readings; 0: not given */
    tl_condition condition;         /* in use, for a matched look-up; all 0: none */
    size_t of;                      /* index of its signal in the file; may be its own */
    bool is_reading;                /* this is NAME@reading */
    size_t shows;                   /* of NAME@reading: index of the matched look-up */
} tl_config_signal;

enum { TL_CONFIG_WORDS = 48 }; /* bytes of `words`, including the NUL */

/* `detect.says`: the user's description of an adjusted variable or a signal, shown in findings. */
typedef struct tl_config_words {
    const char *name; /* "component.variable" or "plant.signal" */
    const char *words;
} tl_config_words;

/* `detect.alarm`: limits of the mean correction Δu of an adjusted variable, in its unit. */
typedef struct tl_config_alarm {
    size_t adjust;          /* index in tl_config.adjust */
    double above, below;    /* ±infinity: no limit */
    tl_time averaging_time; /* ns over which Δu is averaged */
} tl_config_alarm;

/* `emulate`: values that `twinlock plant` serves when it simulates the true plant with FMUs. */
typedef struct tl_config_emulated {
    const char *where;
    const char *column; /* column in the served rows; the signal with this `column` reads it */
    const char *from;   /* "component.variable" or "plant.signal" */
    double noise;       /* standard deviation, in the variable's unit; 0: none */
} tl_config_emulated;

enum {
    TL_CONFIG_PARTICIPANTS = 16,   /* of `delays`, at most */
    TL_CONFIG_LONGEST_SHIFT = 1000 /* macro steps: longest shift or wait of a look-up */
};

/* A chain of `delays`: the participants that a signal passes, in order, and the probability density
 * of its delay. */
typedef struct tl_config_chain {
    size_t length;
    size_t parts[TL_DELAY_CHAIN]; /* indices in tl_config_delays.participants */
    tl_delay_density density;
} tl_config_chain;

/* Two chains that start with the same command; both have length 0 if the delay itself is given. */
typedef struct tl_config_pair {
    tl_config_chain plant, simulation;
    tl_time delay; /* Δi or Δo, ns: most likely delay of `simulation` minus that of `plant` */
} tl_config_pair;

/* `delays`: time differences between plant and simulation (dissertation, eq. 4.14 to 4.16). */
typedef struct tl_config_delays {
    size_t participant_count;
    const char *names[TL_CONFIG_PARTICIPANTS];
    tl_delay_participant participants[TL_CONFIG_PARTICIPANTS];
    bool has_input, has_output; /* `input`, `output` are configured */
    bool measure;               /* Δo is measured while the twin runs */
    tl_time range;              /* ns; a measured delay is limited to −range … range */
    bool next;                  /* ŷ between two readings: the next one; false: the one before */
    tl_config_pair input, output;
    tl_time shift; /* ns; ŷ look-up at t_j + this: −Δo, plus Δi with `input`; 0 without `output` */
    tl_time wait;  /* ns; wait for the next reading: one cycle of the plant, else T_S; 0: none */
} tl_config_delays;

typedef struct tl_config {
    const char *path;      /* as given */
    const char *directory; /* of `path`; relative file names start here */
    const char *text;      /* bytes of the file, NUL-terminated */
    size_t size;
    char hash[65]; /* SHA-256 of the text, hexadecimal */

    const char *name;
    tl_time step;     /* T_S, ns */
    double start_s;   /* time of the FMUs at tick 0, s; NaN: not given */
    double stop_s;    /* stop time of the FMUs, s; NaN: not given */
    tl_time duration; /* ns; 0: to the end of the recording, or until the run is stopped */

    tl_config_name *fill_in; /* what `init` could not know: a place in the file, and what belongs there */
    size_t fill_in_count;

    tl_config_component *components;
    size_t component_count;
    tl_config_source *sources;
    size_t source_count;
    tl_config_signal *signals;
    size_t own_count;     /* signals in the file: the first ones of `signals` */
    size_t signal_count;  /* own_count; after tl_config_use_lookups() own_count + further_count */
    size_t further_count; /* further look-ups: all NAME@match, then all NAME@reading */
    tl_plan_connection *connections;
    size_t connection_count;

    bool synchronise; /* the section exists; false: adjust_count is 0 */
    tl_plan_adjust *adjust;
    size_t adjust_count;
    tl_plan_find *find; /* as in tl_plan, as the two below */
    size_t find_count;
    uint32_t find_steps;
    tl_plan_match *match;
    size_t match_count;
    tl_between *matched_between; /* of each match: `between` as configured, last or line */
    tl_condition *conditions;    /* of each match: `condition` as configured */
    const char **matched_as;     /* of each match: its look-up, `to` or "plant.NAME@match" */
    const char **reading_as;     /* of each match: "plant.NAME@reading"; NULL: none */
    uint32_t prediction;         /* T_P, macro steps; 0: as short as possible */
    tl_shape shape;
    tl_pairing measurements;
    tl_plan_event event;
    const char *algorithm;   /* solver (master/solve/optimiser.h); NULL: default as in tl_plan */
    const char *fallback;    /* name of a solver; NULL: none */
    uint32_t stagnation;     /* evaluations without progress that stop a solver; 0: never */
    bool has_epsilon;        /* `epsilon` is given; all tolerances are its square root */
    double noise_floor;      /* as in tl_plan (plan.h) */
    uint32_t verify_every;   /* as in tl_plan */
    uint32_t released_steps; /* as in tl_plan */
    bool free_twin;          /* the free-run check is on */
    bool rests;              /* u is nominal while corrections do harm (monitor/lock_monitor.h) */
    double margin;           /* as in tl_plan */
    tl_plan_saving saving;
    uint32_t saving_memory;      /* MiB for the saved states of all FMUs */
    uint32_t budget_evaluations; /* most evaluations of J per step */
    tl_time budget_time;         /* ns per step; 0: limited only by the length of the step */

    const tl_config_delays *delays;              /* NULL: none */
    tl_delay_lookup input_lookup, output_lookup; /* of inputs; of matched signals */

    const char *recording_file;        /* NULL: none */
    const char *recording_time_column; /* default "time" */

    const char *record_file;  /* NULL: the default of the command */
    int64_t record_max_bytes; /* for steps, minutes and hours in the database; then the oldest are deleted */
    tl_time record_commit;    /* ns between two commits */
    tl_time record_resume;    /* ns; a run resumes an earlier one that ended at most this long ago; 0: never */
    /* The command sets both; 0 after reading. With recording_follow, the twin starts at the last
     * checkpoint before this tick and uses the recorded u. */
    int64_t recording_run;    /* run of a database; 0: the last one */
    int64_t recording_follow; /* a tick > 0; 0: the twin starts with the run */

    double false_alarms_per_year; /* accepted number of false findings (change_detector.h) */
    tl_time detect_learn;         /* ns of normal operation that is learned first */
    tl_time detect_cycle;         /* longest recurring cycle of the plant, ns; 0: not known */
    tl_config_words *says;
    size_t says_count;
    tl_config_alarm *alarms;
    size_t alarm_count;

    int realtime_priority;     /* SCHED_FIFO priority, 1 … 98; 0: ordinary scheduling */
    bool realtime_lock_memory; /* lock the memory of the process (mlockall()) */
    tl_time realtime_hang;     /* ns; a cycle hangs if it reports nothing for this time plus 2·T_S */

    tl_config_emulated *emulated;
    size_t emulated_count;
    double message_min_s, message_max_s; /* s, random, between emulated rows; 0: a row each step */

    /* Private; texts of the configuration point into both. */
    tl_arena arena;
    struct cJSON *tree;
} tl_config;

/* Reads and validates the file. On failure every problem was reported, and `config` is empty: there
 * is nothing to free.
 * Errors: TL_BAD_DATA, also if the file is absent, unreadable or too large; TL_TRY_AGAIN if memory
 *         or descriptors are out, or the disk fails. After a syntax error nothing else is checked.
 *         Otherwise all problems are reported, not sorted by line. */
tl_status tl_config_read(const char *path, tl_config *config, tl_report *report);

/* As tl_config_read(), for `size` bytes, which are copied; no NUL is needed. Relative file names
 * start at the folder of `path`, which need not exist. */
tl_status tl_config_read_text(const char *path, const char *text, size_t size, tl_config *config, tl_report *report);

/* Narrows the limits of each signal that feeds FMU inputs to the limits that these inputs declare.
 * Sets `below` or `above` of a narrowed limit: 1 % of the range; if that is infinite, 1 % of the
 * limit or of the nominal value, whichever is larger; 0 for an Enumeration. A signal keeps its
 * limits if no value would remain. `account`: of the twin that was built from `config`. */
void tl_config_use_bounds(tl_config *config, const tl_account *account);

/* Writes for the user why a value of a signal is not good: "18.55 m is outside 0 … 5". `signal`:
 * index. `age`: of the reading, ns. */
enum { TL_CONFIG_DESCRIPTION = 256 };
void tl_config_describe_quality(const tl_config *config, size_t signal, double value, tl_quality quality, tl_time age,
                                char text[TL_CONFIG_DESCRIPTION]);

/* Text of an event: "saving: motor states, drive none". The first function writes what components
 * with "keep": "auto" keep, from component `first` on, as far as there is room; "" if there are
 * none. `unsaved`: see tl_twin_unsaved(). Returns the next component; component_count at the end.
 * The second function returns false if the text is no such event. Else it sets the bits of
 * components with "none" in *unsaved, and clears no bit. */
enum { TL_CONFIG_KEEP_TEXT = 224 };
size_t tl_config_write_keep(const tl_config *config, uint64_t unsaved, size_t first, char text[TL_CONFIG_KEEP_TEXT]);
bool tl_config_read_keep(const tl_config *config, const char *text, uint64_t *unsaved);

/* Returns a remedy for the user, for example "check scale, address, word order". */
const char *tl_config_quality_remedy(const tl_config *config, size_t signal, tl_quality quality);

/* Includes the further look-ups in signal_count. Call it before samples are taken. */
void tl_config_use_lookups(tl_config *config);

/* Returns the number of steps after which a prediction no longer depends on the measurements at its
 * start, at least 2. It is twice the longest every_s of the matched signals (5 steps if none has
 * one), plus the longest memory of a condition. Returns 0 if the free-run check is off. */
uint32_t tl_config_free_twin_guard(const tl_config *config);

/* Outputs of FMUs by bit number in tl_record.bad_outputs: first those of `match`, then the sources
 * of `connect`; bit 63 stands for all further sources. The first function returns the name, "an
 * output" for bit 63, or NULL if there is no such output. The second one returns true if the bit is
 * set and no output with a lower number has the same name. */
enum { TL_CONFIG_OUTPUTS = 64 };

const char *tl_config_output_name(const tl_config *config, size_t output);
bool tl_config_is_bad_output(const tl_config *config, uint64_t bad_outputs, size_t output);

/* Returns true if a component is unconfined. Then all FMUs of its process have all rights of the
 * user. */
bool tl_config_is_unconfined(const tl_config *config);

/* Returns TL_BAD_DATA with the first entry of `fill_in` if there is one: a live run would read
 * placeholders. */
tl_status tl_config_check_filled_in(const tl_config *config, tl_error *error);

/* Returns true if the signal has a source that is polled (Modbus). Two polls can read the same
 * reading. */
bool tl_config_is_polled(const tl_config *config, const tl_config_signal *signal);

/* Returns the time in ns after a reading in which an equal polled value counts as the same reading
 * (plant_reader.h): the shorter of `every_s` and half of `stale_s`, minus one poll period; 0: every
 * poll is a reading. */
tl_time tl_config_repeats(const tl_config *config, const tl_config_signal *signal);

/* Returns the longest expected time between two readings, ns: the longer of `every_s` and the
 * period of a polled source. Returns 0 if neither is known, without a live source, and for a
 * further look-up. */
tl_time tl_config_interval(const tl_config *config, const tl_config_signal *signal);

/* Returns the index of the signal "plant.NAME"; SIZE_MAX if there is none, or for NULL. */
size_t tl_config_signal_of(const tl_config *config, const char *reference);

/* Returns the delay in ns that the condition of a match adds to a measurement: (median − 1)/2
 * readings, one per every_s (default: step_s), plus low_pass_s. `to` must be a signal. */
tl_time tl_config_condition_lag(const tl_config *config, size_t match);

/* Returns the name of the look-up with the unchanged readings of a match, "plant.NAME@reading".
 * Returns NULL if the matched look-up itself has them, and "" if there was no room for a further
 * one. Call it after tl_config_use_lookups(). */
const char *tl_config_reading_of(const tl_config *config, size_t match);

/* Measurement of Δo. REPORTED: by released twins, without effect. USED: shifts the look-up of ŷ. */
typedef enum tl_config_measured { TL_DELAY_NOT_MEASURED, TL_DELAY_REPORTED, TL_DELAY_USED } tl_config_measured;
tl_config_measured tl_config_measures_delay(const tl_config *config);

/* Removes delays, interpolation, conditions and further look-ups, for a process that emulates the
 * plant. Call it before tl_config_use_lookups(). */
void tl_config_forget_delays(tl_config *config);

/* Frees and zeroes the configuration. A zeroed one is allowed. */
void tl_config_free(tl_config *config);

/* The first function copies the values that a running twin can change into `tuning`. The second one
 * sets them from a tuning that fits (tl_tuning_fits()). Text and hash remain those of the file. */
void tl_config_tuning(const tl_config *config, tl_tuning *tuning);
void tl_config_retune(tl_config *config, const tl_tuning *tuning);

/* Reads the tuning from `text`, an earlier configuration. Its problems are not reported. Checks the
 * tuning, but not whether it fits `own`. Errors: TL_BAD_DATA, also if memory is out. */
tl_status tl_config_tuning_of(const tl_config *own, const char *text, tl_tuning *tuning, tl_error *error);

/* Returns the line (from 1) of the item at a JSON path, for problems that the twin finds later. If
 * there is no such item, returns the line of the innermost existing item around it ("plant.omega"
 * for "plant.omega.unit"). Returns 0 for "" and for a path without any existing part. */
size_t tl_config_line(const tl_config *config, const char *where);

/* Finds the file of an FMU: relative to the configuration's folder, then to each folder of
 * TWINLOCK_FMU_PATH (separated by colons), then to ../fmus and ../lib/twinlock/fmus from the
 * program's folder. An absolute name is tried only as written. Returns false if there is no such
 * regular file; `path` is then the first path that was tried. */
bool tl_config_fmu_path(const tl_config *config, const char *fmu, char *path, size_t size);

/* Writes the path of a file that the configuration names; a relative name starts at its folder.
 * Returns false and sets `path` to "" if it does not fit into `size` bytes. */
bool tl_config_file_path(const tl_config *config, const char *file, char *path, size_t size);

/* Writes the name for dlopen(), which searches for a name without a slash. Any other name is a
 * file: see tl_config_file_path(). Returns false if it does not fit into `size` bytes. */
bool tl_config_library_path(const tl_config *config, const char *library, char *path, size_t size);

/* ---- Names of the modes of `synchronise.horizon.measurements`. The mode decides at which tick a
 * step is computed: see tl_twin_facts.lead. */

/* By tl_pairing, ended by NULL: "lag", "ahead", "hold". */
extern const char *const tl_pairing_names[];

/* Returns the mode of that name, or TL_LAG if there is none. NULL is allowed. */
tl_pairing tl_pairing_named(const char *name);

/* ---- Problems of a configuration, logged for the user: one line each.
 *
 * Purpose: a tl_report for tl_config_read() and the twin. Format of a line: "file: line N: JSON
 *          path: what was found, what was expected".
 */

typedef struct tl_problems {
    tl_report report;
    const char *file;
    const tl_config *config; /* NULL during tl_config_read(); set it before the twin is built */
} tl_problems;

/* `file`: name for the log; must outlive `problems`. Do not move `problems`: `report` points to
 * it. */
void tl_problems_init(tl_problems *problems, const char *file);

/* Parses the line number at the start of a problem's text ("line 12: found …") and moves *text
 * after it. Returns 0 if there is none. */
size_t tl_problems_take_line(const char **text);

/* Adds a problem or a warning to the innermost array, as an object with `place` (a JSON path; null:
 * ""), `line` (null: 0) and `text`. */
void tl_problems_add_json(tl_json_writer *json, const char *place, size_t line, const char *text);

/* The same for a problem of `file` as it was logged, or any other error. */
void tl_problems_add_logged(tl_json_writer *json, const char *file, const char *text);

#endif

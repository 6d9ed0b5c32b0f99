/* Resume points from a record queue: see resume.h.
 *
 * The entries since a checkpoint are read once. They may belong to several runs, because each new
 * process begins a run of its own. Each run is a stretch of entries. The newest stretch with a step
 * of its own is resumed.
 */
#include "firmware/twin/resume.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"

enum {
    CHECKPOINTS = 2,
    FRUITLESS =
        TL_RESUME_FRUITLESS -
        1 /* the two checkpoint slots reach back no further than two runs that enqueued the same checkpoint again */
};

static const char *const NO_MEMORY = "not enough memory for the records of the previous run";

/* Remaining entries of one run. */
typedef struct stretch {
    bool is_there;
    bool holds; /* safe hold: without a twin */
    tl_resumption beginning;
    bool has_checkpoint; /* that of `left`, and no gap since */
    bool has_hole;
    bool has_begun;                           /* `ticks` has its first tick */
    tl_resume_ticks ticks;                    /* since the last gap */
    int64_t last;                             /* last tick with a step; −1: none */
    tl_time used;                             /* ns used by searches */
    uint64_t executions;                      /* in so many executions */
    tl_run_tuning tunings[TL_RESUME_TUNINGS]; /* the one that applied at first, and the newest later ones */
    size_t tuning_count;
    bool ended;
    char reason[TL_RECORDER_REASON];
} stretch;

struct tl_resume_queue {
    const tl_record_queue *queue;
    const tl_config *config;
    tl_twin_facts facts;
    tl_resume_listener *report;
    void *context; /* of `report` */
    unsigned resume_point;
    bool was_tried[CHECKPOINTS]; /* checkpoints that were already returned */
    bool has_reported;
    tl_record_queue_saved left;
    stretch newest; /* the stretch that is being read */
    stretch chosen; /* the newest one that can be resumed */
    int fruitless;  /* number of later runs without a step of their own */
    bool is_out_of_memory;
    tl_recorder_entry entry;
    tl_resume found;
    void *image;
    char why[TL_RESUME_WHY];
};

/* ---- one stretch ---- */

static void begin_stretch(tl_resume_queue *self, const tl_resumption *beginning, const tl_run_tuning *active_text) {
    tl_resume_ticks ticks = self->newest.ticks; /* reuses its memory */
    ticks.shape = tl_recorder_shape_of(self->config);
    tl_resume_ticks_begin(&ticks, 0);
    self->newest = (stretch){.is_there = true, .beginning = *beginning, .last = -1, .ticks = ticks};
    self->newest.tunings[0] = *active_text;
    self->newest.tunings[0].tick = 0;
    self->newest.tuning_count = active_text->hash[0] != '\0' ? 1 : 0;
}

/* A run that ended before it had a step of its own contains nothing that the run before it does
 * not. */
static bool has_own_step(const stretch *run) {
    int64_t own = run->beginning.from == TL_RESUMED_NOT ? 0 : run->beginning.tick;
    return run->is_there && !run->holds && run->last >= own;
}

static bool is_tick(const tl_resume_queue *self, int64_t tick) {
    return tick >= 0 && tick <= TL_RESUME_FAR / self->config->step;
}

static void add_sample(tl_resume_queue *self, const tl_sample *sample) {
    stretch *run = &self->newest;
    bool follows = run->has_begun && sample->tick == run->ticks.first + (int64_t)run->ticks.count;
    if (!run->is_there || !is_tick(self, sample->tick)) {
        return;
    }
    if (!follows) {
        run->has_hole = run->has_begun;
        run->has_checkpoint = false;
        run->has_begun = true;
        tl_resume_ticks_begin(&run->ticks, sample->tick);
    }
    self->is_out_of_memory = !tl_resume_ticks_add(&run->ticks, sample) || self->is_out_of_memory;
}

static void add_step(tl_resume_queue *self, const tl_record *record) {
    stretch *run = &self->newest;
    int64_t tick = is_tick(self, record->step) ? record->step + (int64_t)self->facts.lead : -1;
    bool is_sound = run->is_there && is_tick(self, tick);
    for (size_t i = 0; i < self->config->adjust_count; i++) {
        is_sound = is_sound && isfinite(record->u[i]);
    }
    if (!is_sound) {
        return;
    }
    run->last = tick > run->last ? tick : run->last;
    tl_resume_ticks_set_step(&run->ticks, tick, record->u, tl_record_was_reset(record->flags));
    if (record->used > 0 && record->used < TL_SECOND) {
        run->used += record->used;
        run->executions += record->executions;
    }
}

/* The same tick can have two tunings, if a process died in it. If there are too many, the second
 * oldest is dropped. */
static void add_tuning(tl_resume_queue *self, const tl_run_tuning *tuning) {
    stretch *run = &self->newest;
    int64_t before = run->tuning_count != 0 ? run->tunings[run->tuning_count - 1].tick : 0;
    if (!run->is_there || !is_tick(self, tuning->tick) || tuning->tick < before || tuning->hash[0] == '\0') {
        return;
    }
    if (run->tuning_count == TL_RESUME_TUNINGS) {
        run->tuning_count--;
        memmove(&run->tunings[1], &run->tunings[2], (TL_RESUME_TUNINGS - 2) * sizeof run->tunings[0]);
    }
    run->tunings[run->tuning_count++] = *tuning;
}

/* ---- reading the entries ---- */

static void choose_newest(tl_resume_queue *self) {
    stretch earlier = self->chosen;
    self->chosen = self->newest;
    self->newest = earlier;
}

/* Ends the newest stretch. */
static void close_stretch(tl_resume_queue *self) {
    if (has_own_step(&self->newest)) {
        self->fruitless = 0;
        choose_newest(self);
    } else {
        self->fruitless += self->newest.is_there && !self->newest.holds ? 1 : 0;
    }
}

static void add_entry(tl_resume_queue *self, const tl_recorder_entry *entry) {
    switch (entry->kind) {
    case TL_ENTRY_START:
        close_stretch(self);
        begin_stretch(self, &entry->start.resumption, &entry->start.configured);
        self->newest.holds = entry->start.holds;
        break;
    case TL_ENTRY_SAMPLE:
        add_sample(self, &entry->sample);
        break;
    case TL_ENTRY_STEP:
        add_step(self, &entry->record);
        break;
    case TL_ENTRY_END:
        self->newest.ended = true;
        memcpy(self->newest.reason, entry->reason, sizeof entry->reason);
        break;
    case TL_ENTRY_TUNING:
        add_tuning(self, &entry->tuning);
        break;
    }
}

/* Starts at a checkpoint slot; or, if no checkpoint exists, at the first entry, if that was not
 * overwritten. */
static bool begin_reading(tl_resume_queue *self, unsigned which, uint64_t *position) {
    *position = 0;
    if (!tl_record_queue_saved_checkpoint(self->queue, which, &self->left)) {
        return which == 0;
    }
    if (self->left.tick < -1 || !is_tick(self, self->left.tick + 1)) {
        return false;
    }
    begin_stretch(self, &self->left.beginning, &self->left.tuning);
    self->newest.has_checkpoint = self->left.size != 0;
    self->newest.has_begun = self->left.size != 0;
    self->newest.last = self->left.tick;
    tl_resume_ticks_begin(&self->newest.ticks, self->left.tick + 1);
    *position = self->left.position;
    return true;
}

/* Reads all entries since then. `any_run`: if no run has a step of its own, chooses the newest one.
 * Returns false if there is no such checkpoint, or if memory is out. */
static bool read_entries(tl_resume_queue *self, unsigned which, bool any_run) {
    uint64_t position = 0;
    self->chosen.is_there = false;
    self->newest.is_there = false;
    self->fruitless = 0;
    if (!begin_reading(self, which, &position)) {
        return false;
    }
    while (!self->is_out_of_memory && tl_record_queue_saved_entry(self->queue, &position, &self->entry)) {
        add_entry(self, &self->entry);
    }
    close_stretch(self);
    if (any_run && !self->chosen.is_there && self->newest.is_there && !self->newest.holds) {
        choose_newest(self);
    }
    return !self->is_out_of_memory;
}

/* ---- the rule ---- */

static bool can_resume(tl_resume_queue *self, const stretch *run) {
    tl_time start = run->beginning.start;
    bool is_near = start >= -TL_RESUME_FAR && start <= TL_RESUME_FAR;
    tl_time gap = is_near ? tl_clock_now(NULL) - tl_time_of_step(start, self->config->step, run->last) : -1;
    return tl_resume_was_interrupted(TL_RESUME_UNNUMBERED, run->ended ? run->reason : NULL, self->why) &&
           tl_resume_is_in_time(TL_RESUME_UNNUMBERED, self->config, run->last, gap, self->facts.lead, self->why);
}

static int64_t most_followed(const tl_resume_queue *self, const stretch *run) {
    tl_time each = run->executions > 0 ? run->used / (tl_time)run->executions : 0;
    return tl_resume_most_followed(each < TL_SECOND ? each : TL_SECOND, self->facts.components);
}

/* ---- making a resume point ---- */

static void make_point(tl_resume_queue *self, stretch *run, tl_resumed_from from, int64_t first, int64_t last) {
    run->tuning_count = tl_resume_choose_tunings(run->tunings, run->tuning_count, first, last);
    self->found = (tl_resume){
        .from = from,
        .run = TL_RESUME_UNNUMBERED,
        .first = first,
        .last = last,
        .step = self->config->step,
        .start_s = run->beginning.start_s,
        .start = run->beginning.start,
        .started = run->beginning.started,
        .checkpoint = from == TL_RESUMED_CHECKPOINT ? self->left.bytes : NULL,
        .checkpoint_size = from == TL_RESUMED_CHECKPOINT ? self->left.size : 0,
        .tunings = (const unsigned char *)run->tunings,
        .tuning_count = run->tuning_count,
        .shape = run->ticks.shape,
        .ticks = run->ticks.bytes + (size_t)(first - run->ticks.first) * tl_resume_tick_bytes(&run->ticks.shape),
    };
    tl_resume_identify(self->config, self->found.signals);
}

/* In mode ahead the ticks may reach one tick further. */
static bool take_checkpoint(tl_resume_queue *self, stretch *run) {
    int64_t last = tl_resume_ticks_last(&run->ticks, run->ticks.first);
    bool leads = run->has_checkpoint && last >= run->last && last - self->left.tick <= most_followed(self, run);
    if (leads) {
        make_point(self, run, TL_RESUMED_CHECKPOINT, run->ticks.first, last);
    }
    return leads;
}

/* Without a checkpoint: all entries if there is time to follow them, else the newest. */
static bool take_inputs(tl_resume_queue *self, stretch *run) {
    int64_t most = most_followed(self, run);
    bool is_there = run->last - run->ticks.first < (int64_t)run->ticks.count;
    bool long_ago = run->last - run->ticks.first + 1 > most;
    int64_t first = long_ago ? run->last - most + 1 : run->ticks.first;
    if (!is_there || (run->has_hole && !long_ago) || tl_resume_ticks_last(&run->ticks, first) != run->last) {
        return tl_resume_refuse(self->why, "the last recorded ticks of the previous run have a gap");
    }
    make_point(self, run, first == 0 ? TL_RESUMED_START : TL_RESUMED_INPUTS, first, run->last);
    return true;
}

/* ---- iteration ---- */

/* Order of tries: each checkpoint slot, at first only for a run with a step of its own; then the
 * entries alone. */
typedef struct resume_point {
    unsigned which;
    bool with_checkpoint;
    bool any_run;
} resume_point;

static const resume_point candidates[] = {{0, true, false}, {1, true, false}, {0, true, true},
                                          {1, true, true},  {1, false, true}, {0, false, true}};
enum { ATTEMPTS = sizeof candidates / sizeof candidates[0] };

/* *over: no resume point remains. */
static bool try_next(tl_resume_queue *self, const resume_point *now, bool *over) {
    if ((now->with_checkpoint && self->was_tried[now->which]) || !read_entries(self, now->which, now->any_run)) {
        return false;
    }
    if (self->fruitless >= FRUITLESS) {
        *over = true;
        return tl_resume_refuse(self->why, "the last %d runs ended before their first own step", self->fruitless);
    }
    if (!self->chosen.is_there) {
        return tl_resume_refuse(self->why,
                                "the record queue does not reach back to the last steps of the previous run");
    }
    *over = !can_resume(self, &self->chosen);
    if (*over) {
        return false;
    }
    if (!now->with_checkpoint) {
        return take_inputs(self, &self->chosen);
    }
    self->was_tried[now->which] = take_checkpoint(self, &self->chosen);
    return self->was_tried[now->which];
}

static void report_why(const tl_resume_queue *self, const char *why) {
    tl_resume_report(self->report, self->context, TL_EVENT_INFO, "starts a new run: %.200s", why);
}

/* Writes the image and reads it back with the usual validation. */
static bool make_image(tl_resume_queue *self, tl_resume *resume) {
    const tl_resume *found = &self->found;
    tl_error error = {TL_OK, ""};
    size_t size = tl_resume_size(found);
    free(self->image);
    self->image = malloc(size);
    if (self->image == NULL) {
        report_why(self, NO_MEMORY);
        return false;
    }
    tl_resume_write(found, self->image);
    bool sound = tl_resume_read(self->image, size, self->config, tl_clock_now(NULL), resume, &error) == TL_OK;
    if (!sound) {
        report_why(self, error.text);
    }
    return sound;
}

bool tl_resume_queue_next(tl_resume_queue *left, tl_resume *resume) {
    bool found = false;
    bool over = left == NULL;
    while (!found && !over && left->resume_point < ATTEMPTS) {
        found = try_next(left, &candidates[left->resume_point++], &over);
    }
    if (found) {
        (void)tl_resume_refuse(left->why, "no other resume point of the previous run remains"); /* for the next call */
        found = make_image(left, resume);
    } else if (left != NULL && !left->has_reported) {
        report_why(left, left->is_out_of_memory ? NO_MEMORY : left->why);
    }
    if (!found && left != NULL) {
        left->has_reported = true;
        left->resume_point = ATTEMPTS;
    }
    return found;
}

/* Returns true if the queue contains data of a run with a twin: a checkpoint, or, if the first
 * entry was not overwritten, any run that is not in safe hold. */
static bool has_data(tl_resume_queue *self) {
    uint64_t position = 0;
    bool holds = false;
    bool is_left = tl_record_queue_saved_checkpoint(self->queue, 0, &self->left);
    while (!is_left && tl_record_queue_saved_entry(self->queue, &position, &self->entry)) {
        holds = self->entry.kind == TL_ENTRY_START ? self->entry.start.holds : holds;
        is_left = !holds;
    }
    return is_left;
}

tl_resume_queue *tl_resume_queue_open(const tl_record_queue *queue, const tl_assembly *assembly,
                                      tl_resume_listener *report, void *context) {
    tl_resume_queue *opened = assembly->config.record_resume != 0 ? calloc(1, sizeof *opened) : NULL;
    if (opened == NULL) {
        return NULL;
    }
    opened->queue = queue;
    opened->config = &assembly->config;
    opened->facts = tl_twin_get_facts(assembly->twin);
    opened->report = report;
    opened->context = context;
    (void)tl_resume_refuse(opened->why, "the checkpoints of the previous run are damaged");
    if (!has_data(opened)) {
        tl_resume_queue_close(opened);
        return NULL;
    }
    return opened;
}

void tl_resume_queue_close(tl_resume_queue *left) {
    if (left != NULL) {
        tl_resume_ticks_free(&left->newest.ticks);
        tl_resume_ticks_free(&left->chosen.ticks);
        free(left->image);
        free(left);
    }
}

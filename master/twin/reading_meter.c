/* Reading meter: see reading_meter.h. */
#include "master/twin/reading_meter.h"

#include <math.h>

/* A waiting reading. */
typedef struct waiting {
    tl_time time;
    double value;
} waiting;

struct tl_reading_meter {
    tl_time step;
    size_t room;
    size_t count;   /* waiting readings, the oldest first */
    tl_time newest; /* time of the newest reading */
    bool has_y;
    tl_time end; /* of the last step */
    double y;    /* output at that time */
    waiting *waiting;
};

tl_reading_meter *tl_reading_meter_create(tl_arena *arena, tl_time step, size_t room) {
    tl_reading_meter *meter = tl_arena_take(arena, 1, sizeof *meter);
    if (meter == NULL) {
        return NULL;
    }
    meter->step = step;
    meter->room = room;
    meter->newest = TL_TIME_NEVER;
    meter->waiting = tl_arena_take(arena, room, sizeof *meter->waiting);
    return meter->waiting != NULL ? meter : NULL;
}

static void forget_oldest(tl_reading_meter *meter, size_t count) {
    for (size_t i = count; i < meter->count; i++) {
        meter->waiting[i - count] = meter->waiting[i];
    }
    meter->count -= count;
}

void tl_reading_meter_add_reading(tl_reading_meter *meter, tl_time time, double value, tl_quality quality,
                                  tl_metrics *metrics) {
    if (time <= meter->newest) {
        return;
    }
    meter->newest = time;
    if (quality == TL_OUTLIER) {
        metrics->left_out++;
    }
    if (quality != TL_GOOD || !isfinite(value)) {
        return;
    }
    if (meter->count == meter->room) {
        forget_oldest(meter, 1);
    }
    meter->waiting[meter->count++] = (waiting){.time = time, .value = value};
}

void tl_reading_meter_step(tl_reading_meter *meter, tl_time end, double y, bool continues, tl_metrics *metrics) {
    tl_time begin = end - meter->step;
    bool has_line = continues && meter->has_y && meter->end == begin;
    size_t due = 0;
    for (; due < meter->count && meter->waiting[due].time <= end; due++) {
        const waiting *reading = &meter->waiting[due];
        if (has_line && reading->time > begin) {
            double share = (double)(reading->time - begin) / (double)meter->step;
            tl_metrics_add(metrics, meter->y + share * (y - meter->y), reading->value, TL_GOOD);
        }
    }
    forget_oldest(meter, due);
    meter->has_y = true;
    meter->end = end;
    meter->y = y;
}

void tl_reading_meter_archive(tl_reading_meter *meter, tl_archive *archive) {
    tl_archive_part(archive, &meter->count, sizeof meter->count);
    tl_archive_part(archive, &meter->newest, sizeof meter->newest);
    tl_archive_flag(archive, &meter->has_y);
    tl_archive_part(archive, &meter->end, sizeof meter->end);
    tl_archive_part(archive, &meter->y, sizeof meter->y);
    for (size_t i = 0; i < meter->room; i++) {
        tl_archive_part(archive, &meter->waiting[i].time, sizeof meter->waiting[i].time);
        tl_archive_part(archive, &meter->waiting[i].value, sizeof meter->waiting[i].value);
        tl_archive_require_finite(archive, &meter->waiting[i].value, 1);
    }
    tl_archive_require(archive, meter->count <= meter->room);
}

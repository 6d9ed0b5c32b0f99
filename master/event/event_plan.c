/* The plan of an event horizon: see event_plan.h. */
#include "master/event/event_plan.h"

#include <string.h>

static size_t steps_of(tl_time time, tl_time step) {
    return (size_t)((time + step / 2) / step);
}

size_t tl_event_plan_half(const tl_plan *plan) {
    size_t half = steps_of(plan->event.window, plan->step) / 2;
    return half > 0 ? half : 1;
}

size_t tl_event_plan_longest(const tl_plan *plan) {
    return steps_of(plan->event.longest, plan->step);
}

size_t tl_event_plan_signal(const tl_plan *plan, const tl_plan_edge *edge) {
    for (size_t i = 0; i < plan->signal_count; i++) {
        if (strncmp(edge->signal, "plant.", 6) == 0 && strcmp(plan->signals[i].name, edge->signal + 6) == 0) {
            return i;
        }
    }
    return SIZE_MAX;
}

static void check_edge(const tl_plan *plan, const tl_plan_edge *edge, const char *key, tl_report *report) {
    size_t index = tl_event_plan_signal(plan, edge);
    if (index == SIZE_MAX) {
        tl_report_add(report, TL_BAD_DATA, plan->event.where, "\"%s\": found \"%s\", expected \"plant.SIGNAL\"", key,
                      edge->signal);
    } else if (plan->signals[index].type != TL_BOOLEAN) {
        tl_report_add(report, TL_BAD_DATA, plan->event.where,
                      "\"%s\": %s is %s, expected a Boolean signal: give it \"type\": \"boolean\"", key, edge->signal,
                      tl_type_name(plan->signals[index].type));
    }
}

static void check_matches(const tl_plan *plan, tl_report *report) {
    bool matched = false;
    for (size_t i = 0; i < plan->match_count; i++) {
        const tl_plan_match *match = &plan->match[i];
        matched = matched || (match->weight > 0.0 && strcmp(match->to, plan->event.end.signal) == 0);
    }
    if (!matched) {
        tl_report_add(report, TL_BAD_DATA, plan->event.where,
                      "no match with a weight is compared with %s, the end of the stroke", plan->event.end.signal);
    }
}

static void check_times(const tl_plan *plan, tl_report *report) {
    const tl_plan_event *event = &plan->event;
    if (plan->step <= 0) {
        return;
    }
    if (event->window < 2 * plan->step || event->longest / 2 < event->window / 2) {
        tl_report_add(report, TL_BAD_DATA, event->where,
                      "\"window_s\": found %g s, expected at least two macro steps (%g s) and at most \"longest_s\"",
                      tl_seconds(event->window), 2.0 * tl_seconds(plan->step));
    }
    if (event->longest / plan->step > TL_LONGEST_STROKE) {
        tl_report_add(report, TL_BAD_DATA, event->where,
                      "\"longest_s\": found %g s, expected at most %d macro steps (%g s)", tl_seconds(event->longest),
                      TL_LONGEST_STROKE, TL_LONGEST_STROKE * tl_seconds(plan->step));
    }
}

void tl_event_plan_check(const tl_plan *plan, tl_report *report) {
    check_edge(plan, &plan->event.start, "start", report);
    check_edge(plan, &plan->event.end, "end", report);
    check_matches(plan, report);
    check_times(plan, report);
    if (plan->adjust_count != 1) {
        tl_report_add(report, TL_BAD_DATA, "synchronise.adjust",
                      "found %u variables, expected one: an event horizon searches one u",
                      (unsigned)plan->adjust_count);
    }
    if (plan->measurements == TL_AHEAD) {
        tl_report_add(report, TL_BAD_DATA, "synchronise.horizon.measurements",
                      "found \"ahead\", expected \"lag\" or \"hold\" with horizon.event");
    }
    if (plan->measure.lags != 0) {
        tl_report_add(report, TL_BAD_DATA, "delays",
                      "measured delays do not go with horizon.event: give them in chains");
    }
    if (plan->shape == TL_DYNAMIC || plan->prediction != 0) {
        tl_report_add(report, TL_BAD_DATA, plan->event.where,
                      "\"prediction\" and \"shape\" do not go with \"event\": the stroke is the horizon, with one u");
    }
}

size_t tl_event_plan_window(const tl_plan *plan) {
    return 2 * tl_event_plan_longest(plan) + 2 * tl_event_plan_half(plan) + 4;
}

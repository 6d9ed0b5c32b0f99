/* Account of a twin: see account.h. */
#include "master/twin/account.h"

#include <math.h>
#include <string.h>

#include "master/base/text.h"
#include "master/twin/twin_parts.h"

/* Replaces characters that a terminal would obey, and cuts before an incomplete character. */
static void copy_text(char to[TL_ACCOUNT_TEXT], const char *from) {
    size_t left = strlen(from);
    size_t end = 0;
    while (left > 0) {
        uint32_t code = 0;
        size_t length = tl_utf8_read(from, left, &code);
        bool stays = length > 0 && tl_utf8_can_be_shown(code);
        size_t added = stays ? length : 1;
        if (end + added >= TL_ACCOUNT_TEXT) {
            break;
        }
        memcpy(to + end, stays ? from : "?", added);
        end += added;
        from += length > 0 ? length : 1;
        left -= length > 0 ? length : 1;
    }
    to[end] = '\0';
}

static void take_component(const tl_twin *twin, size_t index, tl_account_component *component) {
    tl_twin_ledger entry = tl_twin_get_ledger(twin, index);
    copy_text(component->name, entry.name);
    component->plain = entry.plain;
    component->predicted = entry.predicted;
    component->executions = entry.executions;
    component->repeated = entry.repeated;
    component->uncached = entry.uncached;
    component->nodes_peak = entry.nodes_peak;
}

static void take_ports(const tl_twin *twin, tl_account *account) {
    while (account->matches < TL_MAX_MATCH && twin->match_ports[account->matches] != NULL) {
        tl_account_match *match = &account->match[account->matches];
        copy_text(match->unit, tl_twin_match_unit(twin, account->matches));
        match->type = twin->match_ports[account->matches]->variable->type;
        match->metrics = *tl_twin_metrics(twin, account->matches);
        match->readings = *tl_twin_readings(twin, account->matches);
        match->released = *tl_twin_released(twin, account->matches);
        account->matches++;
    }
    while (account->adjusts < TL_MAX_ADJUST && twin->adjust_ports[account->adjusts] != NULL) {
        tl_account_adjust *adjust = &account->adjust[account->adjusts];
        copy_text(adjust->unit, tl_twin_adjust_unit(twin, account->adjusts));
        tl_twin_adjusted adjusted = tl_twin_get_adjusted(twin, account->adjusts);
        adjust->type = twin->adjust_ports[account->adjusts]->variable->type;
        adjust->step = adjusted.step;
        adjust->lower = adjusted.lower;
        adjust->upper = adjusted.upper;
        adjust->least = adjusted.least;
        adjust->most = adjusted.most;
        account->adjusts++;
    }
}

static void take_finding(const tl_twin_finding *from, tl_account_finding *finding) {
    if (from->component != NULL) {
        copy_text(finding->component, from->component);
        copy_text(finding->variable, from->variable != NULL ? from->variable : "");
        copy_text(finding->unit, from->unit);
        finding->step = from->step;
        finding->after = from->after;
        finding->mended = from->mended;
        finding->cause = (uint32_t)from->cause;
        finding->committed = from->committed;
        finding->again = from->again;
        finding->tolerances = from->tolerances;
    }
}

void tl_account_take(const tl_twin *twin, tl_account *account) {
    tl_twin_facts facts = tl_twin_get_facts(twin);
    memset(account, 0, sizeof *account);
    account->components =
        facts.components < TL_ACCOUNT_COMPONENTS ? (uint32_t)facts.components : (uint32_t)TL_ACCOUNT_COMPONENTS;
    account->prediction = facts.prediction;
    account->experiment = facts.experiment;
    account->lead = facts.lead;
    account->verified = facts.verified;
    account->verified_executions = facts.verified_executions;
    account->differed = facts.differed;
    account->has_free_twin = facts.has_free_twin ? 1 : 0;
    account->free_twin = facts.free_twin;
    account->released_state = (uint32_t)facts.released_state;
    account->released_steps = facts.released_steps;
    account->released = facts.released;
    take_finding(&twin->finding, &account->finding);
    account->complete = tl_twin_ledger_is_complete(twin) ? 1 : 0;
    account->delay = tl_twin_get_delay(twin);
    copy_text(account->algorithm, facts.algorithm);
    copy_text(account->fallback, facts.fallback);
    for (size_t i = 0; i < account->components; i++) {
        take_component(twin, i, &account->component[i]);
        account->replayed += tl_twin_get_ledger(twin, i).replay.steps;
    }
    take_ports(twin, account);
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        tl_twin_bounds bounds = tl_twin_get_bounds(twin, i);
        account->signal[i] = (tl_account_signal){bounds.least, bounds.most, bounds.scale, bounds.items};
    }
}

/* Whether it ends and can be shown as it is. */
static bool is_text(const char text[TL_ACCOUNT_TEXT]) {
    size_t i = 0;
    while (i < TL_ACCOUNT_TEXT && text[i] != '\0') {
        uint32_t code = 0;
        size_t length = tl_utf8_read(text + i, TL_ACCOUNT_TEXT - i, &code);
        if (length == 0 || !tl_utf8_can_be_shown(code)) {
            return false;
        }
        i += length;
    }
    return i < TL_ACCOUNT_TEXT;
}

/* An enumeration in another process's memory may hold any value. */
static bool is_type(tl_type type) {
    return (unsigned)type <= (unsigned)TL_ENUMERATION;
}

bool tl_account_is_sound(const tl_account *account) {
    bool sound = account->components <= TL_ACCOUNT_COMPONENTS && account->matches <= TL_MAX_MATCH &&
                 account->adjusts <= TL_MAX_ADJUST && isfinite(account->experiment.start_s) &&
                 isfinite(account->experiment.stop_s) && is_text(account->algorithm) && is_text(account->fallback) &&
                 is_text(account->finding.component) && is_text(account->finding.variable) &&
                 is_text(account->finding.unit) && account->finding.mended < TL_REPAIRED_COUNT &&
                 account->finding.cause < TL_RESTORE_CAUSES && account->released_state < TL_RELEASED_STATES &&
                 (unsigned)account->delay.state <= (unsigned)TL_DELAY_LOST;
    for (size_t i = 0; sound && i < account->components; i++) {
        sound = is_text(account->component[i].name);
    }
    for (size_t i = 0; sound && i < account->matches; i++) {
        sound = is_text(account->match[i].unit) && is_type(account->match[i].type);
    }
    for (size_t i = 0; sound && i < account->adjusts; i++) {
        sound = is_text(account->adjust[i].unit) && is_type(account->adjust[i].type);
    }
    return sound;
}

uint64_t tl_account_executions(const tl_account *account) {
    uint64_t total = 0;
    for (size_t i = 0; i < account->components; i++) {
        total += account->component[i].executions;
    }
    return total;
}

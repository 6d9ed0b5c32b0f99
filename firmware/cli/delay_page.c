/* The delays of a configuration, for people: see delay_page.h. */
#include "firmware/cli/delay_page.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

enum { WIDTH = 79, MARGIN = 15, COLUMNS = WIDTH - MARGIN - 1, ROWS = 5, NAME = 80 };

static double milliseconds(tl_time time) {
    return (double)time / 1e6;
}

/* ---- chains ---- */

/* Names with = between those on one time base, and → to the next one; broken between participants. */
static void print_chain(const tl_config_delays *delays, const tl_config_chain *chain, const char *label, FILE *file) {
    int column = fprintf(file, "    %-11s", label);
    for (size_t i = 0; i < chain->length; i++) {
        const char *name = delays->names[chain->parts[i]];
        bool same =
            i > 0 && delays->participants[chain->parts[i - 1]].base == delays->participants[chain->parts[i]].base;
        int length = (int)strlen(name) + (i > 0 ? 3 : 0);
        if (i > 0 && column + length > WIDTH) {
            column = fprintf(file, "\n    %-11s", "") - 1;
        }
        (void)fprintf(file, "%s%.*s", i == 0 ? "" : same ? " = " : " \342\206\222 ", NAME, name);
        column += length;
    }
    (void)fputc('\n', file);
}

/* ---- drawings ---- */

/* The density in the middle of each column; what is constant stands in one column. Returns the largest. */
static double sample(const tl_delay_density *density, tl_time cell, double *heights) {
    double top = 0.0;
    for (int i = 0; i < COLUMNS; i++) {
        bool constant = density->count == 0 && density->dead / cell == i;
        heights[i] = constant ? 1.0 : tl_delay_density_at(density, cell * i + cell / 2);
        top = fmax(top, heights[i]);
    }
    return top;
}

static void print_density(const tl_delay_density *density, tl_time cell, const char *label, FILE *file) {
    double heights[COLUMNS];
    double top = sample(density, cell, heights);
    tl_time mode = tl_delay_mode(density);
    int marked = (int)(mode / cell);
    for (int row = ROWS; row > 0; row--) {
        char line[COLUMNS + 1] = {0};
        int length = 0;
        for (int i = 0; i < COLUMNS; i++) {
            line[i] = heights[i] > 0.0 && heights[i] >= top * (row - 0.5) / ROWS ? '#' : ' ';
            length = line[i] == '#' ? i + 1 : length;
        }
        (void)fprintf(file, "    %-11s|%.*s\n", row == ROWS ? label : "", length, line);
    }
    (void)fprintf(file, "    %11s+", "");
    for (int i = 0; i < COLUMNS; i++) {
        (void)fputc(i == marked ? '^' : '-', file);
    }
    char text[32];
    int length = snprintf(text, sizeof text, "%.6g ms", milliseconds(mode));
    int place = marked - length / 2;
    place = place < 0 ? 0 : place > COLUMNS - length ? COLUMNS - length : place;
    (void)fprintf(file, "\n    %11s %*s%s\n", "", place, "", text);
}

static tl_time longer(tl_time a, tl_time b) {
    return a > b ? a : b;
}

/* Both on one axis, with some room behind the longer one. */
static void print_densities(const tl_config_pair *pair, FILE *file) {
    tl_time longest = longer(tl_delay_longest(&pair->plant.density), tl_delay_longest(&pair->simulation.density));
    tl_time cell = (longest + longest / 16) / COLUMNS + 1;
    print_density(&pair->plant.density, cell, "plant", file);
    print_density(&pair->simulation.density, cell, "simulation", file);
}

/* ---- the page ---- */

static bool has_chains(const tl_config_pair *pair) {
    return pair->plant.length > 0;
}

static void print_modes(const tl_config_pair *pair, const char *what, const char *symbol, FILE *file) {
    if (!has_chains(pair)) {
        (void)fprintf(file, "  %-8s%s = %.6g ms, as given\n", what, symbol, milliseconds(pair->delay));
        return;
    }
    (void)fprintf(file, "  %-8s%s = %.6g ms: modes %.6g ms of the simulation, %.6g ms of the plant\n", what, symbol,
                  milliseconds(pair->delay), milliseconds(tl_delay_mode(&pair->simulation.density)),
                  milliseconds(tl_delay_mode(&pair->plant.density)));
}

static void print_pair(const tl_config_delays *delays, const tl_config_pair *pair, FILE *file) {
    if (!has_chains(pair)) {
        return;
    }
    print_chain(delays, &pair->plant, "plant", file);
    print_chain(delays, &pair->simulation, "simulation", file);
}

/* "… seen at t", "… seen 0.5 ms after". */
static void print_shift(const char *what, tl_time shift, FILE *file) {
    if (shift == 0) {
        (void)fprintf(file, "%s at t", what);
    } else {
        (void)fprintf(file, "%s %.6g ms %s", what, milliseconds(shift < 0 ? -shift : shift),
                      shift < 0 ? "before" : "after");
    }
}

static void print_measured(const tl_config_delays *delays, FILE *file) {
    if (delays->measure) {
        (void)fprintf(file,
                      "  measure \316\224o, from y and \305\267, up to %.6g ms either way%s;\n"
                      "          once it is sure it is used in whole steps, until then:\n",
                      milliseconds(delays->range), delays->has_input ? " of \316\224i" : "");
    }
}

void tl_delay_page_print(const tl_config *config, FILE *file) {
    const tl_config_delays *delays = config->delays;
    if (delays == NULL) {
        return;
    }
    (void)fputs("delays\n", file);
    if (delays->has_input) {
        print_modes(&delays->input, "input", "\316\224i", file);
        print_pair(delays, &delays->input, file);
    }
    if (delays->has_output) {
        print_modes(&delays->output, "output", "\316\224o", file);
        print_pair(delays, &delays->output, file);
    }
    if (delays->has_output && has_chains(&delays->output)) {
        print_densities(&delays->output, file);
    } else if (delays->has_input && has_chains(&delays->input)) {
        print_densities(&delays->input, file);
    }
    print_measured(delays, file);
    (void)fputs("  used    ", file);
    print_shift("inputs at t are those seen", delays->has_input ? delays->input.delay : 0, file);
    (void)fputs(",\n          ", file);
    print_shift("y at t is paired with the \305\267 seen", delays->shift, file);
    (void)fputs(
        (delays->has_output || delays->measure) && !delays->next ? ",\n          or with the newest before" : "", file);
    if (delays->wait > 0) {
        (void)fprintf(file, ",\n          or with the next one, for which a step waits %.6g ms",
                      milliseconds(delays->wait));
    }
    (void)fputc('\n', file);
}

/* GPIO lines: see gpio_lines.h. */
#include "board/gpio/gpio_lines.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* ---- gpio find ---- */

enum { LIST = 160 };

typedef struct search {
    const char *chip;
    const tl_gpio_channel *channel;
    tl_gpio_found first, second;
    size_t found;
    char chips[LIST];  /* chips that were searched */
    char denied[LIST]; /* one that could not be opened, and why */
    unsigned lines;    /* of the last searched chip */
} search;

static int is_chip(const struct dirent *entry) {
    return strncmp(entry->d_name, "gpiochip", 8) == 0;
}

/* True if this is the requested chip. */
static bool is_wanted(const char *wanted, const char *path, const tl_gpio_chip *chip) {
    struct stat given;
    struct stat here;
    return wanted == NULL || strcmp(wanted, tl_gpio_chip_name(chip)) == 0 ||
           strcmp(wanted, tl_gpio_chip_label(chip)) == 0 ||
           (wanted[0] == '/' && stat(wanted, &given) == 0 && S_ISCHR(given.st_mode) && stat(path, &here) == 0 &&
            given.st_rdev == here.st_rdev);
}

static void add_found(search *own, const tl_gpio_found *candidate) {
    if (own->found == 0) {
        own->first = *candidate;
    } else if (own->found == 1) {
        own->second = *candidate;
    }
    own->found++;
}

static void search_lines(search *own, tl_gpio_chip *chip, tl_gpio_found *candidate) {
    const char *name = own->channel->line;
    unsigned begin = name == NULL ? own->channel->offset : 0;
    for (unsigned offset = begin; offset < own->lines; offset++) {
        candidate->offset = offset;
        if (tl_gpio_chip_read_line(chip, offset, &candidate->state) == 0 &&
            (name == NULL || strcmp(name, candidate->state.name) == 0)) {
            add_found(own, candidate);
        }
        if (name == NULL) {
            return;
        }
    }
}

static void search_chip(search *own, const char *file) {
    tl_gpio_found candidate = {.offset = 0};
    struct stat what;
    (void)snprintf(candidate.path, sizeof candidate.path, "/dev/%.40s", file);
    if (lstat(candidate.path, &what) != 0 ||
        !S_ISCHR(what.st_mode)) { /* skips links: they lead to a chip that is searched anyway */
        return;
    }
    tl_gpio_chip *chip = tl_gpio_chip_open(candidate.path);
    if (chip == NULL) {
        (void)snprintf(own->denied, sizeof own->denied, "; %s cannot be opened: %s", candidate.path, strerror(errno));
        return;
    }
    (void)snprintf(candidate.chip, sizeof candidate.chip, "%.32s (%.32s)", tl_gpio_chip_name(chip),
                   tl_gpio_chip_label(chip));
    if (is_wanted(own->chip, candidate.path, chip)) {
        size_t used = strlen(own->chips);
        (void)snprintf(own->chips + used, sizeof own->chips - used, "%s%s", used > 0 ? ", " : "", candidate.chip);
        own->lines = tl_gpio_chip_lines(chip);
        search_lines(own, chip, &candidate);
    }
    tl_gpio_chip_close(chip);
}

static void describe_not_found(const search *own, char *text, size_t size) {
    if (own->chips[0] == '\0' && own->chip != NULL) {
        (void)snprintf(text, size, "no chip has the name, label or path %.64s (see `gpiodetect`)%s", own->chip,
                       own->denied);
    } else if (own->chips[0] == '\0') {
        (void)snprintf(text, size, "there is no GPIO chip%s",
                       own->denied[0] != '\0' ? own->denied : ": load its driver");
    } else if (own->channel->line == NULL) {
        (void)snprintf(text, size, "offset %u is too large: %s has the lines 0 to %u", own->channel->offset, own->chips,
                       own->lines - 1);
    } else {
        (void)snprintf(text, size, "no line has this name on %s (see `gpioinfo`)%s", own->chips, own->denied);
    }
}

bool tl_gpio_find(const char *chip, const tl_gpio_channel *channel, tl_gpio_found *candidate, char *text, size_t size) {
    search own = {.chip = chip, .channel = channel};
    struct dirent **entries = NULL;
    int count = scandir("/dev", &entries, is_chip, alphasort);
    for (int i = 0; i < count; i++) {
        search_chip(&own, entries[i]->d_name);
        free(entries[i]);
    }
    free(entries);
    if (own.found == 0) {
        describe_not_found(&own, text, size);
    } else if (own.found > 1) {
        (void)snprintf(text, size, "two lines fit, %s line %u and %s line %u: add \"chip\", or use \"offset\"",
                       own.first.chip, own.first.offset, own.second.chip, own.second.offset);
    }
    *candidate = own.first;
    return own.found == 1;
}

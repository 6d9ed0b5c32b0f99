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
    tl_gpio_place first, second;
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

static void note(search *own, const tl_gpio_place *place) {
    if (own->found == 0) {
        own->first = *place;
    } else if (own->found == 1) {
        own->second = *place;
    }
    own->found++;
}

static void look_at_lines(search *own, tl_gpio_chip *chip, tl_gpio_place *place) {
    const char *name = own->channel->line;
    unsigned begin = name == NULL ? own->channel->offset : 0;
    for (unsigned offset = begin; offset < own->lines; offset++) {
        place->offset = offset;
        if (tl_gpio_chip_read_line(chip, offset, &place->state) == 0 &&
            (name == NULL || strcmp(name, place->state.name) == 0)) {
            note(own, place);
        }
        if (name == NULL) {
            return;
        }
    }
}

static void look_at_chip(search *own, const char *file) {
    tl_gpio_place place = {.offset = 0};
    struct stat what;
    (void)snprintf(place.path, sizeof place.path, "/dev/%.40s", file);
    if (lstat(place.path, &what) != 0 ||
        !S_ISCHR(what.st_mode)) { /* skips links: they lead to a chip that is searched anyway */
        return;
    }
    tl_gpio_chip *chip = tl_gpio_chip_open(place.path);
    if (chip == NULL) {
        (void)snprintf(own->denied, sizeof own->denied, "; %s cannot be opened: %s", place.path, strerror(errno));
        return;
    }
    (void)snprintf(place.chip, sizeof place.chip, "%.32s (%.32s)", tl_gpio_chip_name(chip), tl_gpio_chip_label(chip));
    if (is_wanted(own->chip, place.path, chip)) {
        size_t used = strlen(own->chips);
        (void)snprintf(own->chips + used, sizeof own->chips - used, "%s%s", used > 0 ? ", " : "", place.chip);
        own->lines = tl_gpio_chip_lines(chip);
        look_at_lines(own, chip, &place);
    }
    tl_gpio_chip_close(chip);
}

static void describe_nothing(const search *own, char *text, size_t size) {
    if (own->chips[0] == '\0' && own->chip != NULL) {
        (void)snprintf(text, size, "there is no chip %.64s%s", own->chip, own->denied);
    } else if (own->chips[0] == '\0') {
        (void)snprintf(text, size, "there is no GPIO chip%s", own->denied);
    } else if (own->channel->line == NULL) {
        (void)snprintf(text, size, "%s has the lines 0 to %u only", own->chips, own->lines - 1);
    } else {
        (void)snprintf(text, size, "no line has that name on %s%s", own->chips, own->denied);
    }
}

bool tl_gpio_find(const char *chip, const tl_gpio_channel *channel, tl_gpio_place *place, char *text, size_t size) {
    search own = {.chip = chip, .channel = channel};
    struct dirent **entries = NULL;
    int count = scandir("/dev", &entries, is_chip, alphasort);
    for (int i = 0; i < count; i++) {
        look_at_chip(&own, entries[i]->d_name);
        free(entries[i]);
    }
    free(entries);
    if (own.found == 0) {
        describe_nothing(&own, text, size);
    } else if (own.found > 1) {
        (void)snprintf(text, size,
                       "it is there twice: %s line %u, and %s line %u; say which by \"chip\", or by \"offset\"",
                       own.first.chip, own.first.offset, own.second.chip, own.second.offset);
    }
    *place = own.first;
    return own.found == 1;
}

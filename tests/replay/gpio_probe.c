/* The GPIO driver as a program, for tests/hil/box/test_live_gpio.py.
 *
 *   gpio_probe SECONDS PERIOD_S CHIP LINE...   prints what the driver posts and says, for so long
 * CHIP: - is any. LINE: a name, or # and an offset; then any of :low (active low), :up, :down, :none (bias), :SECONDS
 * (debouncing). Output: "post CHANNEL VALUE QUALITY STAMP", "up TEXT", "down TEXT"; levels that repeat are left out.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "board/gpio/gpio.h"
#include "board/io/monotonic.h"
#include "tests/replay/probe.h"

enum { LINES = 16 };

static tl_reading newest[LINES];
static bool any[LINES];

static void on_post(void *context, size_t channel, const tl_reading *reading) {
    (void)context;
    if (!any[channel] || reading->value < newest[channel].value || reading->value > newest[channel].value ||
        reading->quality != newest[channel].quality) {
        (void)printf("post %zu %g %d %lld\n", channel, reading->value, (int)reading->quality,
                     (long long)reading->stamp);
        (void)fflush(stdout);
    }
    if (any[channel] && reading->quality == TL_GOOD && reading->stamp < newest[channel].stamp) {
        (void)printf("down the stamp of channel %zu goes back\n", channel);
    }
    any[channel] = true;
    newest[channel] = *reading;
}

static void on_link(void *context, bool up, const char *text) {
    (void)context;
    (void)printf("%s %s\n", up ? "up" : "down", text);
    (void)fflush(stdout);
}

static void take_word(const char *word, tl_gpio_channel *channel) {
    channel->active_low = channel->active_low || strcmp(word, "low") == 0;
    channel->bias = strcmp(word, "up") == 0 ? TL_GPIO_PULL_UP : channel->bias;
    channel->bias = strcmp(word, "down") == 0 ? TL_GPIO_PULL_DOWN : channel->bias;
    channel->bias = strcmp(word, "none") == 0 ? TL_GPIO_NO_PULL : channel->bias;
    channel->debounce_s = strtod(word, NULL) > 0 ? strtod(word, NULL) : channel->debounce_s;
}

static tl_gpio_channel channel_of(char *text) {
    char *rest = NULL;
    char *word = strtok_r(text, ":", &rest);
    tl_gpio_channel channel = {.line = word[0] == '#' ? NULL : word};
    channel.offset = word[0] == '#' ? (unsigned)strtoul(word + 1, NULL, 10) : 0;
    while ((word = strtok_r(NULL, ":", &rest)) != NULL) {
        take_word(word, &channel);
    }
    return channel;
}

int main(int argc, char **argv) {
    tl_gpio_channel channels[LINES];
    tl_error error = {.status = TL_OK};
    tl_plant_io *io = NULL;
    if (argc < 5 || argc - 4 > LINES) {
        return tl_probe_fail("say SECONDS PERIOD_S CHIP LINE...");
    }
    for (int i = 4; i < argc; i++) {
        channels[i - 4] = channel_of(argv[i]);
    }
    const tl_gpio_settings settings = {.chip = strcmp(argv[3], "-") == 0 ? NULL : argv[3],
                                       .period_s = strtod(argv[2], NULL),
                                       .channels = channels,
                                       .channel_count = (size_t)argc - 4};
    const tl_plant_io_sink sink = {.post = on_post, .link = on_link};
    if (tl_gpio_open(&settings, &io, &error) != TL_OK) {
        return tl_probe_fail(error.text);
    }
    const tl_time end = tl_monotonic_now() + tl_time_of_seconds(strtod(argv[1], NULL));
    while (tl_monotonic_now() < end) {
        tl_gpio_driver.poll(io, &sink);
    }
    tl_gpio_driver.close(io);
    return EXIT_SUCCESS;
}

/* Last words: see last_word.h. */
#include "firmware/retune/last_word.h"

#include <signal.h>
#include <string.h>
#include <unistd.h>

static const char *volatile said;

static void say(int signal_) {
    const char *word = said;
    if (word != NULL) {
        (void)!write(STDERR_FILENO, "\n", 1);
        (void)!write(STDERR_FILENO, word, strlen(word));
        (void)!write(STDERR_FILENO, "\n", 1);
    }
    (void)raise(signal_); /* by default now, once this returns */
}

static void claim(int signal_) {
    struct sigaction action = {.sa_handler = SIG_DFL};
    if (sigaction(signal_, NULL, &action) != 0 || action.sa_handler != SIG_DFL) {
        return;
    }
    action = (struct sigaction){.sa_handler = say, .sa_flags = (int)SA_RESETHAND};
    (void)sigemptyset(&action.sa_mask);
    (void)sigaction(signal_, &action, NULL);
}

void tl_last_word_set(const char *word) {
    said = word;
    claim(SIGINT);
    claim(SIGTERM);
}

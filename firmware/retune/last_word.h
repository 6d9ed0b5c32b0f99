/* A last word: what somebody should know who ends this program while what it has begun goes on elsewhere.
 *
 * Purpose: Ctrl-C ends who follows a change, and not the change. The word is printed to standard error, and the program ends by the signal, as without it.
 * Signals: SIGINT and SIGTERM; one that is ignored stays so.
 * Thread:  one, in programs that do not end in good order by themselves (interrupt.h).
 */
#ifndef TL_FIRMWARE_RETUNE_LAST_WORD_H
#define TL_FIRMWARE_RETUNE_LAST_WORD_H

/* From now on. `word`: a line, without its end; it must stay. NULL: there is nothing to say any more. */
void tl_last_word_set(const char *word);

#endif

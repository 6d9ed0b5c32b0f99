/* The library of by_name.c. */
__attribute__((visibility("default"))) unsigned long count_step(void);

unsigned long count_step(void) {
    static unsigned long steps;
    return ++steps;
}

/* Starts the twin of a configuration in a separate process, as the commands do. That process
 * executes the test's program again. */
#ifndef TL_TESTS_SUPPORT_START_TWIN_H
#define TL_TESTS_SUPPORT_START_TWIN_H

#include <stddef.h>

#include <unity.h>

#include "firmware/process/process_end.h"
#include "firmware/process/role.h"
#include "firmware/twin/twin_child.h"
#include "firmware/twin/twin_role.h"

/* First call of main(): does not return in the process of a twin. */
static inline void tl_test_be_twin(char *const *argv) {
    static const tl_twin_role_tasks tasks = {.print_page = NULL};
    if (tl_role_begin(argv) != NULL) {
        tl_process_end(tl_twin_role_run(&tasks));
    }
}

/* Starts the process and builds the twin. `config` must outlive the child. */
static inline tl_twin_child *tl_test_start_twin(const tl_config *config, tl_twin_attached attached,
                                                tl_account *account) {
    static tl_twin_job job;
    const tl_twin_child_settings settings = {.job = &job, .config = config};
    tl_twin_child *child = NULL;
    tl_error error;
    job = (tl_twin_job){.task = TL_TASK_STEP, .attached = attached, .path = config->path, .text = config->text};
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_start(&settings, &child, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_child_build(child, account, &error), error.text);
    return child;
}

#endif

/* twinlock: entry point of the program. Runs the role of this process, or the command line. */
#include "firmware/base/os.h"
#include "firmware/cli/command_line.h"
#include "firmware/cli/roles.h"
#include "firmware/process/crash.h"
#include "firmware/process/process_end.h"
#include "firmware/process/role.h"

int main(int argc, char **argv) {
    const char *title = tl_role_begin(argv);
    tl_process_begin();
    tl_crash_install();
    tl_locale_use();
    tl_process_end(title != NULL ? tl_roles_run(title) : tl_command_line_run(argc, argv));
}

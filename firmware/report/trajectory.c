/* A trajectory file: see trajectory.h. */
#include "firmware/report/trajectory.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "firmware/report/show.h"

tl_status tl_trajectory_open(const char *path, FILE *output, const tl_config *config, FILE **file, tl_error *error) {
    *file = strcmp(path, "-") == 0 ? output : fopen(path, "w");
    if (*file == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: cannot be written: %s", path, strerror(errno));
    }
    (void)fputs("time,step,outcome,evaluations,J", *file);
    for (size_t i = 0; i < config->match_count; i++) {
        tl_show_csv_name(*file, config->match[i].variable, "");
        tl_show_csv_name(*file, config->match[i].to, "");
        tl_show_csv_name(*file, config->match[i].to, " quality");
    }
    for (size_t i = 0; i < config->adjust_count; i++) {
        tl_show_csv_name(*file, config->adjust[i].variable, "");
        tl_show_csv_name(*file, config->adjust[i].variable, " nominal");
    }
    (void)fputc('\n', *file);
    return TL_OK;
}

void tl_trajectory_add(FILE *file, const tl_config *config, const tl_record *record) {
    (void)fprintf(file, "%.9f,%" PRId64 ",%s,%" PRIu32 ",",
                  tl_seconds(tl_time_of_step(0, config->step, record->step + 1)), record->step,
                  tl_outcome_name(record->outcome), record->evaluations);
    if (isfinite(record->objective)) {
        (void)fprintf(file, "%.17g", record->objective);
    }
    for (size_t i = 0; i < config->match_count; i++) {
        (void)fprintf(file, ",%.17g,%.17g,%s", record->y[i], record->y_hat[i],
                      tl_quality_name((tl_quality)record->y_hat_quality[i]));
    }
    for (size_t i = 0; i < config->adjust_count; i++) {
        (void)fprintf(file, ",%.17g,%.17g", record->u[i], record->u_hat[i]);
    }
    (void)fputc('\n', file);
}

tl_status tl_trajectory_close(FILE *file, FILE *output, const char *path, tl_error *error) {
    bool failed = ferror(file) != 0;
    errno = EIO; /* what an earlier failure is called where closing finds nothing left to fail */
    if (file == output) {
        failed = fflush(file) != 0 || failed;
    } else {
        failed = fclose(file) != 0 || failed;
    }
    return failed ? tl_fail(error, TL_TRY_AGAIN, "%s: not everything could be written: %s", path, strerror(errno))
                  : TL_OK;
}

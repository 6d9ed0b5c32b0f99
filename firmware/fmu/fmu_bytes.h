/* The bytes of an FMU that is led back by copies of its memory, though its own states are exact.
 *
 * Purpose: a checkpoint is read by another process, in which a copy of memory is of no use. So the FMU is led to the copy, makes its own state there, and turns that into
 *          bytes; the other way round a state of its own is made from bytes, and the FMU is copied as it is with it. In between it is as if nothing had been called.
 * Source:  FMI 2.0.4, section 2.1.8 (fmi2SerializeFMUstate). The functions are those of FMI's table, for an instance behind the guard (fmu_ladder.h), and for states that are copies.
 * Errors:  fmi2Error: there is no memory for it, the FMU has what no copy takes back, or has refused.
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_FMU_FMU_BYTES_H
#define TL_FIRMWARE_FMU_FMU_BYTES_H

#include "firmware/fmu/fmu_guarded.h"

fmi2Status tl_fmu_bytes_size(fmi2Component component, fmi2FMUstate copy, size_t *size);
fmi2Status tl_fmu_bytes_write(fmi2Component component, fmi2FMUstate copy, fmi2Byte bytes[], size_t size);
fmi2Status tl_fmu_bytes_read(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *copy);

#endif

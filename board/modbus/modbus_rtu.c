/* Serial line of the Modbus driver: RTU, one request at a time, with silence between them.
 *
 * libmodbus opens the port, builds the frames, and receives and checks them. But no thread can end
 * its wait for a response, and a port has no shutdown(). So libmodbus sends, this code waits for
 * the first byte, and libmodbus receives the rest, which takes a short time.
 *
 * A response has no number. So late, incomplete or garbled bytes must be over before the next
 * request: a request starts when the line has been quiet for 3.5 characters. After a failure it
 * must be quiet for 50 ms, because a USB adapter delivers its bytes every 16 ms.
 * Source: MODBUS over Serial Line 1.02, section 2.5.1.
 */
#include "board/modbus/modbus_link.h"

#include <errno.h>
#include <linux/major.h>
#include <linux/serial.h>
#include <modbus.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/select.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <termios.h>
#include <unistd.h>

#include "board/io/monotonic.h"

#define MILLISECOND (TL_SECOND / 1000)
#define QUIET_AFTER_FAILURE (50 * MILLISECOND)
#define QUIET_IF_FAST (1750000) /* above 19200 Bd, at any speed */
#define GAPS_IN_A_FRAME (200 * MILLISECOND)

enum { CHECK_SUM = 2, REQUEST = TL_MODBUS_BODY_REQUEST + CHECK_SUM };
enum { OVERHEAD = 3 + CHECK_SUM }; /* bytes of a response besides its values */

typedef struct rtu_link {
    tl_modbus_link link;
    modbus_t *context;
    char *device;
    bool echo;
    bool rs485;
    tl_time character; /* ns on the wire */
    tl_time quiet;     /* between two frames */
    tl_time last;      /* when a byte was last sent or received */
    bool failed;       /* the last request */
} rtu_link;

/* ---- the port ---- */

static void rtu_close(tl_modbus_link *link) {
    if (link->descriptor >= 0) {
        (void)tcflush(link->descriptor, TCIOFLUSH); /* otherwise closing may wait until all is sent */
        (void)ioctl(link->descriptor, TIOCNXCL);
        modbus_close(((rtu_link *)link)->context);
        link->descriptor = -1;
    }
}

/* The port's driver switches between sending and receiving and does not receive its own bytes. */
static int switch_rs485(int descriptor) {
    struct serial_rs485 setting;
    memset(&setting, 0, sizeof setting);
    if (ioctl(descriptor, TIOCGRS485, &setting) != 0) {
        return errno;
    }
    setting.flags |= SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND;
    setting.flags &= ~(__u32)(SER_RS485_RTS_AFTER_SEND | SER_RS485_RX_DURING_TX);
    return ioctl(descriptor, TIOCSRS485, &setting) == 0 ? 0 : errno;
}

/* True if a character device is a serial line by its class in sysfs, which pseudo-terminals do not
 * have. */
static bool is_serial_line(dev_t device) {
    char name[64];
    char subsystem[256];
    (void)snprintf(name, sizeof name, "/sys/dev/char/%u:%u/subsystem", major(device), minor(device));
    ssize_t length = readlink(name, subsystem, sizeof subsystem - 1);
    subsystem[length > 0 ? length : 0] = '\0';
    const char *last = strrchr(subsystem, '/');
    return (last != NULL && strcmp(last, "/tty") == 0) ||
           (major(device) >= UNIX98_PTY_SLAVE_MAJOR && major(device) < UNIX98_PTY_SLAVE_MAJOR + UNIX98_PTY_MAJOR_COUNT);
}

/* Opens only a serial line: opening another device may act, as on a watchdog. Returns 0 or errno.
 */
static int open_port(rtu_link *rtu) {
    struct stat what;
    if (stat(rtu->device, &what) != 0) {
        return errno;
    }
    if (!S_ISCHR(what.st_mode) || !is_serial_line(what.st_rdev)) {
        return ENOTTY;
    }
    if (modbus_connect(rtu->context) != 0) {
        return errno;
    }
    rtu->link.descriptor = modbus_get_socket(rtu->context);
    if (rtu->link.descriptor >= FD_SETSIZE) { /* libmodbus waits with select() */
        return EMFILE;
    }
    return ioctl(rtu->link.descriptor, TIOCEXCL) == 0 ? 0 : errno;
}

static bool rtu_connect(tl_modbus_link *link, char *cause, size_t cause_size) {
    rtu_link *rtu = (rtu_link *)link;
    int failure = open_port(rtu);
    if (failure != 0) {
        const char *why = failure == EBUSY    ? ": another program uses it"
                          : failure == ENOTTY ? ": this is not a serial line"
                          : failure == EACCES ? ": add the user to the device's group, usually dialout"
                                              : ": check device";
        (void)snprintf(cause, cause_size, "cannot be opened: %s%s", strerror(failure), why);
        rtu_close(link);
        return false;
    }
    failure = rtu->rs485 ? switch_rs485(link->descriptor) : 0;
    if (failure != 0) {
        (void)snprintf(cause, cause_size,
                       "the driver cannot switch RS-485 (%s): remove rs485 if the adapter switches it",
                       strerror(failure));
        rtu_close(link);
        return false;
    }
    (void)tcflush(link->descriptor, TCIFLUSH);
    rtu->last = tl_monotonic_now();
    rtu->failed = true; /* the state of the line is unknown */
    return true;
}

/* A device that was unplugged hangs up. Unexpected bytes are dropped before the next request. */
static tl_modbus_health rtu_check(const tl_modbus_link *link) {
    struct pollfd one = {.fd = link->descriptor, .events = POLLIN};
    bool there = poll(&one, 1, 0) >= 0 && (one.revents & (POLLHUP | POLLERR | POLLNVAL)) == 0;
    return there ? TL_MODBUS_SOUND : TL_MODBUS_CLOSED;
}

/* True if the port failed and not the unit. */
static bool is_port_failure(const tl_modbus_outcome *outcome) {
    const int failure = outcome->found;
    return outcome->kind == TL_MODBUS_FAILED && failure != EINTR && failure != ETIMEDOUT && failure != EPROTO &&
           failure != EBUSY && failure != EBADMSG && failure < MODBUS_ENOBASE;
}

static void rtu_failed(tl_modbus_link *link, const tl_modbus_outcome *outcome) {
    rtu_link *rtu = (rtu_link *)link;
    rtu->failed = true;
    rtu->last = tl_monotonic_now();
    if (is_port_failure(outcome)) {
        rtu_close(link);
    }
}

static void rtu_release(tl_modbus_link *link) {
    rtu_link *rtu = (rtu_link *)link;
    rtu_close(link);
    tl_modbus_link_done(link);
    modbus_free(rtu->context);
    free(rtu->device);
    free(rtu);
}

/* ---- a request and its response ---- */

static bool is_readable(int descriptor) {
    struct pollfd one = {.fd = descriptor, .events = POLLIN};
    return poll(&one, 1, 0) > 0;
}

/* Waits until the line is quiet, and drops what comes meanwhile. Returns 0 or errno. */
static int await_quiet(rtu_link *rtu) {
    const int descriptor = rtu->link.descriptor;
    const tl_time quiet = rtu->failed ? QUIET_AFTER_FAILURE : rtu->quiet;
    const tl_time end = tl_monotonic_now() + rtu->link.timeout + quiet;
    while (rtu->last <= end) {
        uint8_t dropped[256];
        int failure = tl_modbus_link_await(&rtu->link, descriptor, POLLIN, rtu->last + quiet);
        if (failure == ETIMEDOUT && !is_readable(descriptor)) { /* there was perhaps nothing to wait for */
            return 0;
        }
        if (failure != 0 && failure != ETIMEDOUT) {
            return failure;
        }
        if (read(descriptor, dropped, sizeof dropped) <= 0) { /* readable without bytes: it was hung up */
            return EIO;
        }
        rtu->last = tl_monotonic_now();
    }
    return EBUSY;
}

/* Returns 0 or errno. */
static int send_request(rtu_link *rtu, const tl_modbus_read *read) {
    uint8_t request[TL_MODBUS_BODY_REQUEST];
    tl_modbus_put_body(read, request);
    errno = EIO;
    return modbus_set_slave(rtu->context, read->unit_id) == 0 &&
                   modbus_send_raw_request(rtu->context, request, sizeof request) == REQUEST
               ? 0
               : errno;
}

/* Receives the request that was just sent. Returns 0 or errno; EBADMSG: it does not come. */
static int drop_echo(rtu_link *rtu, const tl_modbus_read *read_request, tl_time deadline) {
    const tl_modbus_question asked = {.read = read_request};
    uint8_t sent[TL_MODBUS_TCP_REQUEST];
    uint8_t echo[REQUEST] = {0};
    size_t size = 0;
    tl_modbus_put_framed(&asked, sent);
    while (size < sizeof echo) {
        int failure = tl_modbus_link_await(&rtu->link, rtu->link.descriptor, POLLIN, deadline);
        if (failure != 0) {
            return failure == ETIMEDOUT ? EBADMSG : failure;
        }
        ssize_t count = read(rtu->link.descriptor, echo + size, sizeof echo - size);
        if (count <= 0) { /* readable without bytes: it was hung up */
            return EIO;
        }
        size += (size_t)count;
    }
    return memcmp(sent, echo, sizeof echo) == 0 ? 0 : EBADMSG;
}

/* Receives the whole response after its first byte. Returns its length, or −errno. */
static int receive(rtu_link *rtu, const tl_modbus_read *read, uint8_t *response, tl_time deadline) {
    int failure = tl_modbus_link_await(&rtu->link, rtu->link.descriptor, POLLIN, deadline);
    if (failure != 0) {
        return -failure;
    }
    tl_time limit = (tl_time)(tl_modbus_value_bytes(read) + OVERHEAD) * rtu->character + GAPS_IN_A_FRAME;
    (void)modbus_set_response_timeout(rtu->context, (uint32_t)(limit / TL_SECOND),
                                      (uint32_t)(limit % TL_SECOND / 1000));
    int length = modbus_receive_confirmation(rtu->context, response);
    if (length >= 0) {
        return length;
    }
    return errno == ETIMEDOUT ? -EPROTO : -errno;
}

static tl_modbus_outcome failed_with(int failure) {
    tl_modbus_outcome outcome = {.kind = TL_MODBUS_FAILED, .found = failure};
    return outcome;
}

/* libmodbus has checked the sum, except if another unit answers: then it reports length 0. */
static tl_modbus_outcome check(const tl_modbus_read *read, const uint8_t *response, size_t length) {
    return tl_modbus_check_rtu(read, response, length < OVERHEAD ? OVERHEAD - CHECK_SUM : length - CHECK_SUM);
}

static tl_modbus_outcome rtu_ask(tl_modbus_link *link, const tl_modbus_read *read, tl_modbus_values *values) {
    rtu_link *rtu = (rtu_link *)link;
    uint8_t response[MODBUS_RTU_MAX_ADU_LENGTH] = {0};
    int failure = await_quiet(rtu);
    if (failure == 0) {
        failure = send_request(rtu, read);
    }
    if (failure != 0) {
        return failed_with(failure);
    }
    tl_time deadline = tl_monotonic_now() + link->timeout + REQUEST * rtu->character;
    failure = rtu->echo ? drop_echo(rtu, read, deadline) : 0;
    int length = failure == 0 ? receive(rtu, read, response, deadline) : -failure;
    rtu->last = tl_monotonic_now();
    rtu->failed = false;
    if (length < 0) {
        return failed_with(-length);
    }
    tl_modbus_outcome outcome = check(read, response, (size_t)length);
    if (outcome.kind == TL_MODBUS_VALUES) {
        tl_modbus_take_values(read, response + 3, values);
    }
    return outcome;
}

static const tl_modbus_link_kind RTU = {.is_line = true,
                                        .connect = rtu_connect,
                                        .check = rtu_check,
                                        .ask = rtu_ask,
                                        .failed = rtu_failed,
                                        .close = rtu_close,
                                        .release = rtu_release};

static tl_time character_time(const tl_modbus_line *line) {
    unsigned bits = 1 + 8 + (line->parity == 'N' ? 0U : 1U) + line->stop_bits;
    return (tl_time)bits * TL_SECOND / line->baud;
}

tl_modbus_link *tl_modbus_rtu_make(const tl_modbus_line *line, tl_time timeout) {
    rtu_link *rtu = calloc(1, sizeof *rtu);
    if (rtu == NULL) {
        return NULL;
    }
    char name[TL_MODBUS_LINK_NAME];
    const tl_modbus_link_settings settings = {.kind = &RTU, .timeout = timeout, .name = name};
    rtu->device = strdup(line->device);
    rtu->context = modbus_new_rtu(line->device, (int)line->baud, line->parity, 8, line->stop_bits);
    rtu->echo = line->echo;
    rtu->rs485 = line->rs485;
    rtu->character = character_time(line);
    rtu->quiet = line->baud > 19200 ? QUIET_IF_FAST : 7 * rtu->character / 2;
    (void)snprintf(name, sizeof name, "Modbus line %.120s", line->device);
    if (rtu->device == NULL || rtu->context == NULL || !tl_modbus_link_init(&rtu->link, &settings)) {
        modbus_free(rtu->context);
        free(rtu->device);
        free(rtu);
        return NULL;
    }
    /* Without libmodbus's own error recovery, which sleeps. */
    (void)modbus_set_error_recovery(rtu->context, MODBUS_ERROR_RECOVERY_NONE);
    (void)modbus_set_byte_timeout(rtu->context, 0, 0); /* no time-out of its own: that of the response applies */
    return &rtu->link;
}

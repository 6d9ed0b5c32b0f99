/* System calls of the driver process and of the recorder: allowed ones for reconnecting, and
 * refused ones. */
#include "firmware/process/confine.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/can.h>
#include <linux/gpio.h>
#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include <unity.h>

#include "board/can/can.h"
#include "board/csv/csv.h"
#include "board/gpio/gpio.h"
#include "board/modbus/modbus.h"
#include "firmware/base/os.h"
#include "firmware/config/drivers.h"
#include "tests/support/confined.h"
#include "tests/support/scratch.h"

static tl_scratch scratch;
static tl_confined confined;

void setUp(void) {
    tl_confine_facts facts;
    tl_confine_probe(&facts);
    if (!facts.filter) {
        TEST_IGNORE_MESSAGE("no seccomp");
    }
}

void tearDown(void) {
    tl_scratch_empty(&scratch);
}

/* plant: as in tl_confine_settings; NULL: of a recorder. port: the allowed port; 0: none */
static void expect_with(const tl_plant_access *plant, bool names, uint16_t port, tl_confined_body *body,
                        void *context) {
    const char *const resolving[] = {"/etc"};
    const char *const devices[] = {"/dev"};
    const tl_confine_settings settings = {.folder = scratch.folder,
                                          .read = resolving,
                                          .read_count = 1,
                                          .write = devices,
                                          .write_count = 1,
                                          .whole_process = true,
                                          .plant = plant,
                                          .names = names,
                                          .ports = &port,
                                          .port_count = port != 0 ? 1 : 0,
                                          .keeps_files = plant == NULL};
    tl_confined_run(settings, body, context, &confined);
    TEST_ASSERT_EQUAL_INT(0, confined.signal);
    TEST_ASSERT_TRUE(confined.succeeded);
}

static void expect_of(const tl_plant_access *plant, uint16_t port, tl_confined_body *body, void *context) {
    expect_with(plant, false, port, body, context);
}

/* Runs the body for each driver, and for one that resolves names. */
static void expect(tl_confined_body *body, void *context) {
    for (const tl_driver *const *row = tl_drivers; *row != NULL; row++) {
        expect_of((*row)->access, 0, body, context);
    }
    expect_with(&tl_modbus_tcp_access, true, 0, body, context);
}

/* Starts a server on this machine. Returns its socket and, in `address`, its address. */
static int listen_somewhere(struct sockaddr_in *address) {
    socklen_t size = sizeof *address;
    int server = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    *address = (struct sockaddr_in){.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    TEST_ASSERT_EQUAL_INT(0, bind(server, (struct sockaddr *)address, sizeof *address));
    TEST_ASSERT_EQUAL_INT(0, listen(server, 1));
    TEST_ASSERT_EQUAL_INT(0, getsockname(server, (struct sockaddr *)address, &size));
    return server;
}

static bool talk_by_tcp(void *context) {
    int line = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, IPPROTO_TCP);
    int on = 1;
    struct pollfd writable = {.fd = line, .events = POLLOUT};
    return TL_EXPECT(line >= 0 && setsockopt(line, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on) == 0) &&
           TL_EXPECT(connect(line, context, sizeof(struct sockaddr_in)) == 0 || errno == EINPROGRESS) &&
           TL_EXPECT(poll(&writable, 1, 1000) == 1) && TL_EXPECT(send(line, "a", 1, MSG_NOSIGNAL) == 1) &&
           TL_EXPECT(recv(line, &on, 1, 0) == -1 && errno == EAGAIN) && TL_EXPECT(shutdown(line, SHUT_RDWR) == 0);
}

static void a_driver_connects_by_tcp(void) {
    struct sockaddr_in address;
    int server = listen_somewhere(&address);
    expect_of(&tl_modbus_tcp_access, ntohs(address.sin_port), talk_by_tcp, &address);
    TEST_ASSERT_EQUAL_size_t(0, confined.refusal_count);
    (void)close(server);
}

/* Tries each way to connect by TCP. */
static bool fail_to_connect(void *context) {
    const struct sockaddr *address = context;
    int line = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, IPPROTO_TCP);
    char byte = 'a';
    struct iovec part = {&byte, 1};
    const struct msghdr message = {
        .msg_name = context, .msg_namelen = sizeof(struct sockaddr_in), .msg_iov = &part, .msg_iovlen = 1};
    return TL_EXPECT(line >= 0) &&
           TL_EXPECT(connect(line, address, sizeof(struct sockaddr_in)) == -1 && errno == EACCES) &&
           TL_EXPECT(sendto(line, "a", 1, MSG_FASTOPEN, address, sizeof(struct sockaddr_in)) == -1 && errno == EPERM) &&
           TL_EXPECT(sendmsg(line, &message, MSG_FASTOPEN) == -1 && errno == EPERM) &&
           TL_EXPECT(tl_confined_has_no_socket(AF_INET, SOCK_STREAM, IPPROTO_MPTCP)) &&
           TL_EXPECT(tl_confined_has_no_socket(AF_INET6, SOCK_STREAM, IPPROTO_SCTP));
}

static void a_driver_connects_to_its_ports_only(void) {
    if (tl_landlock_version() < 4) {
        TEST_IGNORE_MESSAGE("no TCP ports in Landlock");
    }
    struct sockaddr_in address;
    int server = listen_somewhere(&address);
    const uint16_t other = (uint16_t)(ntohs(address.sin_port) ^ 1U);
    struct pollfd knock = {.fd = server, .events = POLLIN};
    expect_with(&tl_modbus_tcp_access, true, other, fail_to_connect, &address);
    expect_of(&tl_modbus_tcp_access, other, fail_to_connect, &address);
    TEST_ASSERT_EQUAL_INT(0, poll(&knock, 1, 0));
    (void)close(server);
}

static bool find_host(void *context) {
    struct addrinfo *found = NULL;
    const struct addrinfo hints = {.ai_socktype = SOCK_STREAM, .ai_flags = AI_ADDRCONFIG};
    (void)context;
    int failure = getaddrinfo("localhost", "502", &hints, &found);
    if (failure == 0) {
        freeaddrinfo(found);
    }
    return TL_EXPECT(failure == 0);
}

static void a_driver_looks_names_up(void) {
    expect_with(&tl_modbus_tcp_access, true, 53, find_host, NULL);
}

static bool use_can(void *context) {
    int line = socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW);
    const struct sockaddr_can address = {.can_family = AF_CAN};
    (void)context;
    return line < 0 ? TL_EXPECT(errno == EAFNOSUPPORT || errno == EPROTONOSUPPORT)
                    : TL_EXPECT(bind(line, (const struct sockaddr *)&address, sizeof address) == 0);
}

static void a_driver_listens_to_can(void) {
    expect_of(&tl_can_access, 0, use_can, NULL);
}

/* True if the filter refuses the command. /dev/null itself would answer ENOTTY. */
static bool is_refused_command(unsigned long command) {
    char room[4096] = "";
    int device = open("/dev/null", O_RDWR | O_CLOEXEC);
    bool is = ioctl(device, command, room) == -1 && errno == EPERM;
    (void)close(device);
    return is;
}

static bool have_no_network(void *context) {
    const struct sockaddr_in any = {.sin_family = AF_INET};
    const struct msghdr nothing = {.msg_iovlen = 0};
    (void)context;
    return TL_EXPECT(tl_confined_has_no_socket(AF_INET, SOCK_STREAM, 0)) &&
           TL_EXPECT(tl_confined_has_no_socket(AF_INET6, SOCK_STREAM, 0)) &&
           TL_EXPECT(tl_confined_has_no_socket(AF_INET, SOCK_DGRAM, 0)) &&
           TL_EXPECT(tl_confined_has_no_socket(AF_NETLINK, SOCK_RAW, 0)) &&
           TL_EXPECT(connect(STDIN_FILENO, (const struct sockaddr *)&any, sizeof any) == -1 && errno == EPERM) &&
           TL_EXPECT(send(STDIN_FILENO, "", 1, 0) == -1 && errno == EPERM) &&
           TL_EXPECT(sendmsg(STDIN_FILENO, &nothing, 0) == -1 && errno == EPERM);
}

static bool have_no_can(void *context) {
    (void)context;
    return TL_EXPECT(tl_confined_has_no_socket(AF_CAN, SOCK_RAW, CAN_RAW));
}

static bool have_no_devices(void *context) {
    (void)context;
    return TL_EXPECT(is_refused_command(TCSETS)) && TL_EXPECT(is_refused_command(TIOCSRS485)) &&
           TL_EXPECT(is_refused_command(GPIO_GET_LINEHANDLE_IOCTL)) &&
           TL_EXPECT(is_refused_command(GPIO_V2_GET_LINE_IOCTL));
}

static bool be_can(void *context) {
    return use_can(context) && have_no_network(context) && have_no_devices(context);
}

static bool be_tcp(void *context) {
    return TL_EXPECT(tl_confined_has_no_socket(AF_INET, SOCK_DGRAM, 0)) &&
           TL_EXPECT(tl_confined_has_no_socket(AF_NETLINK, SOCK_RAW, 0)) && have_no_can(context) &&
           have_no_devices(context);
}

static bool be_gpio(void *context) {
    return have_no_network(context) && have_no_can(context) && TL_EXPECT(!is_refused_command(GPIO_V2_GET_LINE_IOCTL)) &&
           TL_EXPECT(is_refused_command(TCSETS)) && TL_EXPECT(is_refused_command(GPIO_V2_LINE_SET_VALUES_IOCTL)) &&
           TL_EXPECT(is_refused_command(GPIO_V2_LINE_SET_CONFIG_IOCTL)) &&
           TL_EXPECT(is_refused_command(GPIOHANDLE_SET_LINE_VALUES_IOCTL)) &&
           TL_EXPECT(is_refused_command(GPIOHANDLE_SET_CONFIG_IOCTL));
}

static bool be_csv(void *context) {
    return have_no_network(context) && have_no_can(context) && have_no_devices(context);
}

static void each_kind_of_source_has_its_own_sockets_and_devices(void) {
    expect_of(&tl_can_access, 0, be_can, NULL);
    expect_of(&tl_modbus_tcp_access, 502, be_tcp, NULL);
    expect_of(&tl_gpio_access, 0, be_gpio, NULL);
    expect_of(&tl_csv_access, 0, be_csv, NULL);
}

/* A pseudo-terminal stands for a serial line. Allowed commands reach its driver. */
static bool use_serial_line(void *context) {
    struct termios line;
    int port = open(context, O_RDWR | O_NOCTTY | O_CLOEXEC);
    return TL_EXPECT(port >= 0) && TL_EXPECT(tcgetattr(port, &line) == 0) &&
           TL_EXPECT(tcsetattr(port, TCSANOW, &line) == 0) && TL_EXPECT(tcflush(port, TCIOFLUSH) == 0) &&
           TL_EXPECT(ioctl(port, TIOCEXCL) == 0) && TL_EXPECT(ioctl(port, TIOCNXCL) == 0) &&
           TL_EXPECT(ioctl(port, TIOCGRS485, &line) == -1 && errno != EPERM && errno != EACCES) &&
           TL_EXPECT(ioctl(port, TIOCSTI, "a") == -1 && errno == EPERM);
}

static void a_driver_opens_a_serial_line_again(void) {
    int master = posix_openpt(O_RDWR | O_NOCTTY);
    TEST_ASSERT_TRUE(master >= 0 && grantpt(master) == 0 && unlockpt(master) == 0);
    expect_of(&tl_modbus_rtu_access, 0, use_serial_line, ptsname(master));
    (void)close(master);
}

static void *note(void *context) {
    *(bool *)context = true;
    return NULL;
}

static bool start_thread(void *context) {
    pthread_t thread;
    bool noted = false;
    (void)context;
    bool started = tl_side_thread_start(&thread, 0, note, &noted) == 0;
    return TL_EXPECT(started) && TL_EXPECT(pthread_join(thread, NULL) == 0) && TL_EXPECT(noted);
}

static void a_source_has_a_thread(void) {
    expect(start_thread, NULL);
}

static bool do_what_is_left_out(void *context) {
    const struct sockaddr_in any = {.sin_family = AF_INET};
    char *const nothing[] = {NULL};
    int line = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    (void)context;
    return TL_EXPECT(tl_confined_has_no_socket(AF_UNIX, SOCK_STREAM, 0)) &&
           TL_EXPECT(tl_confined_has_no_socket(AF_UNIX, SOCK_SEQPACKET, 0)) &&
           TL_EXPECT(tl_confined_has_no_socket(AF_PACKET, SOCK_RAW, 0)) &&
           TL_EXPECT(tl_confined_has_no_socket(AF_INET, SOCK_RAW, IPPROTO_ICMP)) &&
           TL_EXPECT(bind(line, (const struct sockaddr *)&any, sizeof any) == -1 && errno == EPERM) &&
           TL_EXPECT(listen(line, 1) == -1 && errno == EPERM) &&
           TL_EXPECT(accept(line, NULL, NULL) == -1 && errno == EPERM) &&
           TL_EXPECT(execve("/bin/true", nothing, nothing) == -1 && errno == EPERM) &&
           TL_EXPECT(fork() == -1 && errno == EPERM);
}

static void no_driver_listens_or_starts_programs(void) {
    expect(do_what_is_left_out, NULL);
}

/* The current folder is writable. */
static bool keep_files(void *context) {
    char *const nothing[] = {NULL};
    int file = open("run.db", O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    int strange = creat("/etc/new", 0600);
    if (strange >= 0) {
        (void)close(strange);
    }
    (void)context;
    return TL_EXPECT(file >= 0) && TL_EXPECT(fchmod(file, 0640) == 0) &&
           TL_EXPECT(rename("run.db", "run.db.damaged-1") == 0) && TL_EXPECT(unlink("run.db.damaged-1") == 0) &&
           TL_EXPECT(strange == -1) && TL_EXPECT(tl_confined_has_no_socket(AF_INET, SOCK_STREAM, 0)) &&
           TL_EXPECT(tl_confined_has_no_socket(AF_CAN, SOCK_RAW, 1)) &&
           TL_EXPECT(tl_confined_has_no_socket(AF_UNIX, SOCK_DGRAM, 0)) &&
           TL_EXPECT(execve("/bin/true", nothing, nothing) == -1 && errno == EPERM) &&
           TL_EXPECT(fork() == -1 && errno == EPERM);
}

static void a_recorder_keeps_files_and_has_no_socket(void) {
    expect_of(NULL, 0, keep_files, NULL);
}

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&scratch, "/tmp", "tl_drivers");
    RUN_TEST(a_driver_connects_by_tcp);
    RUN_TEST(a_driver_connects_to_its_ports_only);
    RUN_TEST(a_driver_looks_names_up);
    RUN_TEST(a_driver_listens_to_can);
    RUN_TEST(each_kind_of_source_has_its_own_sockets_and_devices);
    RUN_TEST(a_driver_opens_a_serial_line_again);
    RUN_TEST(a_source_has_a_thread);
    RUN_TEST(no_driver_listens_or_starts_programs);
    RUN_TEST(a_recorder_keeps_files_and_has_no_socket);
    return tl_scratch_finish(&scratch, UNITY_END());
}

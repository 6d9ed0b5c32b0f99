/* Attacks on files of others: their content, their names and their attributes. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/openat2.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/sysmacros.h>
#include <sys/time.h>
#include <sys/xattr.h>
#include <unistd.h>

#include "tests/fmu/hostile/attack/attack.h"

/* Writes, and retries for 5 s if a terminal is full because its reader is slow. */
static int write_soon(int file, const char *text) {
    struct pollfd ready = {.fd = file, .events = POLLOUT};
    int error = 0;
    int attempts = 0;
    do {
        (void)poll(&ready, 1, 100);
        error = attack_errno(write(file, text, strlen(text)));
    } while (error == EAGAIN && ++attempts < 50);
    return error;
}

int attack_open(const char *path, int flags, const char *text) {
    int file = open(path, flags | O_CLOEXEC | O_NOCTTY | O_NONBLOCK, 0666);
    if (file < 0) {
        return errno;
    }
    int error = text == NULL ? 0 : write_soon(file, text);
    (void)close(file);
    return error;
}

static int write_file(char *const words[]) {
    return attack_open(words[0], O_WRONLY, "attack");
}

static int append_file(char *const words[]) {
    return attack_open(words[0], O_WRONLY | O_APPEND, "attack");
}

static int create_file(char *const words[]) {
    return attack_open(words[0], O_WRONLY | O_CREAT, "attack");
}

static int open_truncating(char *const words[]) {
    return attack_open(words[0], O_RDONLY | O_TRUNC, NULL);
}

/* Uses openat2(), whose flags are in memory, where a seccomp filter cannot see them. */
static int open_by_structure(char *const words[]) {
    struct open_how how = {.flags = O_RDONLY | O_TRUNC | O_CLOEXEC};
    long file = syscall(SYS_openat2, AT_FDCWD, words[0], &how, sizeof how);
    int error = attack_errno(file);
    (void)close((int)file);
    return error;
}

static int truncate_file(char *const words[]) {
    return attack_errno(truncate(words[0], 0));
}

static int chmod_file(char *const words[]) {
    return attack_errno(chmod(words[0], 0777));
}

static int chown_file(char *const words[]) {
    return attack_errno(chown(words[0], geteuid(), getegid()));
}

static int utimes_file(char *const words[]) {
    static const struct timeval times[2] = {{.tv_sec = 4711}, {.tv_sec = 4711}};
    return attack_errno(utimes(words[0], times));
}

static int setxattr_file(char *const words[]) {
    return attack_errno(setxattr(words[0], "user.attack", "attack", 6, 0));
}

/* Changes a file through a read-only descriptor. "resources": a file of this FMU, which it may
 * read. */
static int by_descriptor(const char *path, int (*change)(int)) {
    char own[ATTACK_PATH];
    attack_orders_path(own);
    int file = open(strcmp(path, "resources") == 0 ? own : path, O_RDONLY | O_CLOEXEC);
    if (file < 0) {
        return errno;
    }
    int error = attack_errno(change(file));
    (void)close(file);
    return error;
}

static int change_mode(int file) {
    return fchmod(file, 0777);
}

static int change_times(int file) {
    static const struct timespec times[2] = {{.tv_sec = 4711}, {.tv_sec = 4711}};
    return futimens(file, times);
}

static int change_attribute(int file) {
    return fsetxattr(file, "user.attack", "attack", 6, 0);
}

static int fchmod_file(char *const words[]) {
    return by_descriptor(words[0], change_mode);
}

static int futimens_file(char *const words[]) {
    return by_descriptor(words[0], change_times);
}

static int fsetxattr_file(char *const words[]) {
    return by_descriptor(words[0], change_attribute);
}

static int rename_file(char *const words[]) {
    return attack_errno(rename(words[0], words[1]));
}

/* Replaces a file by renaming an own file over it. */
static int rename_over(char *const words[]) {
    int error = attack_open("attack.own", O_WRONLY | O_CREAT, "attack");
    return error != 0 ? error : attack_errno(rename("attack.own", words[0]));
}

static int unlink_file(char *const words[]) {
    return attack_errno(unlink(words[0]));
}

/* Makes a hard link in its own folder, and writes through it. */
static int link_file(char *const words[]) {
    if (link(words[0], "attack.link") != 0) {
        return errno;
    }
    int error = attack_open("attack.link", O_WRONLY, "attack");
    (void)unlink("attack.link");
    return error;
}

static int symlink_file(char *const words[]) {
    if (symlink(words[0], "attack.symlink") != 0) {
        return errno;
    }
    int error = attack_open("attack.symlink", O_WRONLY, "attack");
    (void)unlink("attack.symlink");
    return error;
}

static int make_folder(char *const words[]) {
    return attack_errno(mkdir(words[0], 0777));
}

/* Prints the content, so that the test can see that it was read. */
static int read_file(char *const words[]) {
    char got[8192];
    int file = open(words[0], O_RDONLY | O_CLOEXEC);
    if (file < 0) {
        return errno;
    }
    ssize_t size = 0;
    while ((size = read(file, got, sizeof got)) > 0) {
        for (ssize_t i = 0; i < size; i++) {
            got[i] = (char)(got[i] < ' ' ? ' ' : got[i]);
        }
        (void)dprintf(STDERR_FILENO, "attack has read \"%.*s\"\n", (int)size, got);
    }
    (void)close(file);
    return attack_errno(size);
}

static int list_folder(char *const words[]) {
    DIR *folder = opendir(words[0]);
    if (folder == NULL) {
        return errno;
    }
    for (const struct dirent *entry = readdir(folder); entry != NULL; entry = readdir(folder)) {
        (void)dprintf(STDERR_FILENO, "attack has found \"%s\"\n", entry->d_name);
    }
    (void)closedir(folder);
    return 0;
}

/* PATH TEXT: writes to a device, for example a serial line. Without a text it is only opened. */
static int write_device(char *const words[]) {
    return attack_open(words[0], O_RDWR, words[1][0] != '\0' ? words[1] : NULL);
}

/* MAJOR MINOR TEXT: makes an own device file, and writes to it. */
static int make_device(char *const words[]) {
    dev_t device = makedev((unsigned)strtoul(words[0], NULL, 10), (unsigned)strtoul(words[1], NULL, 10));
    if (mknod("attack.device", S_IFCHR | 0666, device) != 0) {
        return errno;
    }
    int error = attack_open("attack.device", O_WRONLY, words[2]);
    (void)unlink("attack.device");
    return error;
}

const attack attack_files[] = {{"write_file", write_file},
                               {"append_file", append_file},
                               {"create_file", create_file},
                               {"open_truncating", open_truncating},
                               {"open_by_structure", open_by_structure},
                               {"truncate_file", truncate_file},
                               {"chmod_file", chmod_file},
                               {"chown_file", chown_file},
                               {"utimes_file", utimes_file},
                               {"setxattr_file", setxattr_file},
                               {"fchmod_file", fchmod_file},
                               {"futimens_file", futimens_file},
                               {"fsetxattr_file", fsetxattr_file},
                               {"rename_file", rename_file},
                               {"rename_over", rename_over},
                               {"unlink_file", unlink_file},
                               {"link_file", link_file},
                               {"symlink_file", symlink_file},
                               {"make_folder", make_folder},
                               {"read_file", read_file},
                               {"list_folder", list_folder},
                               {"write_device", write_device},
                               {"make_device", make_device},
                               {NULL, NULL}};

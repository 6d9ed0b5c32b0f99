"""Boots a Debian in a folder: its systemd is process 1 of new namespaces, including the network.
Takes two seconds.

Requires root: inside a user namespace, services could not make user namespaces.
"""
import os
import shutil
import subprocess
import time
from pathlib import Path

from live_test import wait_until
from twinlock_test import Failure, Skip, scratch

# Uses pivot_root and no chroot, because a process in a chroot cannot make user namespaces.
BOOT = """
set -e
cd "$1"
mount --make-rprivate /
mount --bind . .
cd "$1"
mount -t proc proc proc
mount -t sysfs sysfs sys
mount -t cgroup2 cgroup2 sys/fs/cgroup
mount -t tmpfs tmpfs run
mount -t tmpfs -o mode=755 tmpfs dev
for name in null zero full random urandom tty; do
    touch dev/$name
    mount --bind /dev/$name dev/$name
done
mkdir dev/pts dev/shm
mount -t devpts -o newinstance,ptmxmode=666 devpts dev/pts
mount -t tmpfs tmpfs dev/shm
ln -s pts/ptmx dev/ptmx
ln -s /proc/self/fd dev/fd
touch dev/console
mount --bind "$2" dev/console
mkdir -p old-root
pivot_root . old-root
cd /
umount -l old-root
exec env -i container=other PATH=/usr/sbin:/usr/bin:/sbin:/bin /lib/systemd/systemd --unit=sysinit.target
"""

ENTER = ["unshare", "--mount", "--pid", "--fork", "--kill-child", "--cgroup", "--uts", "--ipc", "--net"]


class Booted:
    """Boots at the start of `with`; its end kills all processes."""

    def __init__(self, root):
        self.root = root
        self.console = scratch() / "console"
        self.console.touch()
        self.cgroups = scratch()
        self.group = self.cgroups / f"twinlock-test-{os.getpid()}"
        self.process = None
        self.first = 0

    def __enter__(self):
        if os.geteuid() != 0 or Path("/proc/self/uid_map").read_text().split() != ["0", "0", "4294967295"]:
            raise Skip("systemd is booted by root only")
        tried = subprocess.run([*ENTER, "true"], stderr=subprocess.PIPE, encoding="utf-8", check=False)
        if tried.returncode != 0:
            raise Skip(f"no namespaces can be made here: {tried.stderr.strip()}")
        mounted = subprocess.run(["mount", "-t", "cgroup2", "cgroup2", self.cgroups], check=False)
        try:
            self.group.mkdir()
        except OSError as error:
            if mounted.returncode == 0:
                subprocess.run(["umount", self.cgroups], check=False)
            raise Skip(f"no control group can be made here: {error}") from None
        enter = 'echo $$ >"$0/cgroup.procs" && exec "$@"'
        with open(self.console, "wb") as file:
            command = ["sh", "-c", enter, self.group, *ENTER, "sh", "-c", BOOT, "sh", self.root, self.console]
            self.process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=file, stderr=file)
        try:
            self.first = wait_until(self._find_first, "systemd", self.log)
            wait_until(lambda: self.call("is-active", "sysinit.target").returncode == 0, "sysinit.target", self.log)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *unused):
        self.process.kill()
        self.process.wait()
        until = time.monotonic() + 10
        while self.group.exists() and time.monotonic() < until:  # until the kernel has removed all processes
            for folder, _, _ in os.walk(self.group, topdown=False):
                try:
                    os.rmdir(folder)
                except OSError:
                    time.sleep(0.05)
        subprocess.run(["umount", self.cgroups], check=True)
        shutil.rmtree(self.root / "old-root", ignore_errors=True)

    def _find_first(self):
        """Process id, outside, of systemd; 0 if it has not started yet."""
        if self.process.poll() is not None:
            raise Failure(f"not booted\n{self.log()}")
        for pid in Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split():
            if Path(f"/proc/{pid}/comm").read_text().strip() == "systemd":
                return int(pid)
        return 0

    def log(self):
        return self.console.read_text(encoding="utf-8", errors="replace")[-4000:]

    def run(self, *args):
        """Runs a command inside. Returns the finished process."""
        enter = ["nsenter", "--target", str(self.first), "--mount", "--pid", "--cgroup", "--uts", "--ipc", "--net", "--root",
                 "--wdns=/"]
        environment = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL": "C.UTF-8", "DEBIAN_FRONTEND": "noninteractive",
                       "SYSTEMD_PAGER": "", "SYSTEMD_COLORS": "0"}
        return subprocess.run([*enter, *map(str, args)], env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, encoding="utf-8", errors="replace", timeout=60, check=False)

    def run_well(self, *args):
        """Output of a command inside, which must succeed."""
        done = self.run(*args)
        if done.returncode != 0:
            raise Failure(f"{' '.join(map(str, args))} ended with {done.returncode}\n{done.stdout}")
        return done.stdout

    def call(self, *args):
        return self.run("systemctl", *args)

    def property(self, unit, name):
        return self.run_well("systemctl", "show", "--property", name, "--value", unit).strip()

    def journal(self, unit):
        return self.run_well("journalctl", "--no-pager", "--output", "cat", "--unit", unit)

#!/usr/bin/env python3
"""The Debian packages: files, owners, dependencies, and that each build gives the same bytes."""
import gzip
import hashlib
import os
import zipfile

import debian
from debian import output_of
from twinlock_test import BUILD, SOURCE, expect, main, scratch

PACKAGE = debian.make()
ROOT = debian.unpacked(PACKAGE)
SERVE = debian.make(name="twinlock-serve")
TUNE = debian.make(name="twinlock-tune")
SERVE_ROOT = debian.unpacked(SERVE)


def elves():
    """The main program, and the shared objects of the FMUs."""
    folder = scratch()
    for fmu in (ROOT / "usr/lib/twinlock/fmus").glob("*.fmu"):
        with zipfile.ZipFile(fmu) as archive:
            archive.extractall(folder / fmu.stem)
    models = list(folder.glob("*/binaries/*/*.so"))
    expect(len(models) >= 14, f"{len(models)} models")
    return [ROOT / "usr/bin/twinlock", *models]


def test_fields():
    fields = debian.fields(PACKAGE)
    with open(SOURCE / "board/debian/changelog", encoding="utf-8") as file:
        version = file.readline().split()[1].strip("()")
    expect(fields["Package"] == "twinlock" and fields["Version"] == version, f"{fields}")
    expect(fields["Architecture"] == output_of("dpkg", "--print-architecture").strip(), fields["Architecture"])
    expect(PACKAGE.name == f"twinlock_{version}_{fields['Architecture']}.deb", PACKAGE.name)
    program = output_of(ROOT / "usr/bin/twinlock", "--version").split()
    expect(version.rsplit("-", 1)[0] == program[1], f"{version}, but the program is {program}")


def test_it_depends_on_its_libraries_only():
    libraries = {name for elf in elves() for name in debian.needed(elf)}
    expect(len(libraries) >= 9, f"{libraries}")
    wanted = {debian.package_of(name) for name in libraries if not name.startswith("ld-linux")} | {"systemd"}
    found = {part.split()[0] for part in debian.fields(PACKAGE)["Depends"].split(", ")}
    expect(found == wanted, f"Depends has {found - wanted} too much and {wanted - found} too little")
    expect("libc6 (>= " in debian.fields(PACKAGE)["Depends"], "no version of libc6")


def test_the_main_program_has_no_network_library():
    libraries = {name.split(".so")[0] for elf in elves() for name in debian.needed(elf)}
    expect(not libraries & {"libgnutls", "libmicrohttpd"}, f"{libraries}")


def test_the_package_of_the_network():
    own, first = debian.fields(SERVE), debian.fields(PACKAGE)
    expect(own["Package"] == "twinlock-serve" and own["Version"] == first["Version"], f"{own}")
    program = SERVE_ROOT / "usr/bin/twinlock-serve"
    wanted = {debian.package_of(name) for name in debian.needed(program) if not name.startswith("ld-linux")}
    found = {part.split()[0] for part in own["Depends"].split(", ")}
    expect(found == wanted | {"systemd", "twinlock"}, f"Depends has {found}, wanted {wanted}")
    expect(f"twinlock (= {own['Version']})" in own["Depends"], own["Depends"])
    paths = {path for mode, _, path, _ in debian.contents(SERVE) if mode[0] != "d"}
    expect(paths == {f"./{path}" for path in (
        "etc/default/twinlock-serve", "usr/bin/twinlock-serve", "usr/lib/systemd/system/twinlock-serve.service",
        "usr/lib/sysusers.d/twinlock-serve.conf", "usr/share/doc/twinlock-serve/changelog.Debian.gz",
        "usr/share/doc/twinlock-serve/copyright", "usr/share/man/man1/twinlock-serve.1.gz")},
        f"{paths}")
    expect((SERVE_ROOT / "DEBIAN/conffiles").read_text("ascii") == "/etc/default/twinlock-serve\n", "other conffiles")
    others = {path for _, _, path, _ in debian.contents(PACKAGE)}
    expect(not paths & others, f"both packages have {paths & others}")


def test_the_package_of_the_search():
    """A box needs no Python: only this package does."""
    own = debian.fields(TUNE)
    expect(own["Architecture"] == "all" and own["Package"] == "twinlock-tune", f"{own}")
    expect(own["Depends"] == f"twinlock (= {own['Version']}), python3, python3-optuna", own["Depends"])
    expect("python" not in debian.fields(PACKAGE)["Depends"], "the first package depends on Python")
    paths = {path for mode, _, path, _ in debian.contents(TUNE) if mode[0] != "d"}
    expect(paths == {f"./usr/{path}" for path in (
        "bin/twinlock-tune", "share/doc/twinlock-tune/changelog.Debian.gz", "share/doc/twinlock-tune/copyright",
        "share/man/man1/twinlock-tune.1.gz")}, f"{paths}")
    program = (debian.unpacked(TUNE) / "usr/bin/twinlock-tune").read_text(encoding="utf-8")
    expect(program == f"#!/usr/bin/python3\n{(SOURCE / 'script/tune.py').read_text(encoding='utf-8')}", "another program")


def test_owners_and_modes():
    """The same for each umask of the build."""
    for package in ("twinlock", "twinlock-serve", "twinlock-tune"):
        for mode, owner, path, _ in debian.contents(debian.make(umask=0o077, name=package)):
            wanted = {"d": "drwxr-xr-x", "l": "lrwxrwxrwx"}.get(mode[0], "-rwxr-xr-x" if path.startswith(("./usr/bin/", "./usr/lib/twinlock/inbox")) else "-rw-r--r--")
            expect(mode == wanted and owner == "root/root", f"{mode} {owner} {path}")


def test_all_files_are_in_our_folders():
    ours = ("./etc/twinlock/", "./usr/bin/twinlock", "./usr/lib/systemd/system/twinlock-inbox@.path",
            "./usr/lib/systemd/system/twinlock-inbox@.service", "./usr/lib/systemd/system/twinlock@.service",
            "./usr/lib/sysusers.d/twinlock.conf", "./usr/lib/tmpfiles.d/twinlock.conf", "./usr/lib/twinlock/",
            "./usr/lib/udev/rules.d/60-twinlock.rules", "./usr/share/bash-completion/completions/twinlock",
            "./usr/share/doc/twinlock/", "./usr/share/lintian/overrides/twinlock", "./usr/share/man/man1/twinlock.1.gz",
            "./usr/share/man/man5/twinlock.json.5.gz",
            "./usr/share/twinlock/")
    paths = [path for _, _, path, _ in debian.contents(PACKAGE)]
    for path in paths:
        expect(path.startswith(ours) or (path.endswith("/") and any(name.startswith(path) for name in ours)), path)
    for name in ours:
        expect(any(path.startswith(name) for path in paths), f"{name} is missing")
    expect([path for path in paths if path.startswith("./etc/")] == ["./etc/", "./etc/twinlock/"], "more in /etc")


def test_the_examples_are_those_of_the_sources():
    """Without files that a run has left beside them."""
    wanted = {name.removeprefix("config/") for name in debian.sources("config") if not name.startswith(("config/SPEC.md", "config/schema/"))}
    wanted = {name for name in wanted if ".db" not in name}
    folder = ROOT / "usr/share/doc/twinlock/examples"
    found = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    found = {name for name in found if not name.startswith(("systemd/", "schema/"))}
    expect(found == wanted, f"{found - wanted} too much, {wanted - found} too little")


def test_sums_and_control_files():
    expect(sorted(os.listdir(ROOT / "DEBIAN")) == ["control", "md5sums", "postinst", "postrm", "prerm"],
           f"{os.listdir(ROOT / 'DEBIAN')}")
    output_of("md5sum", "--check", "--strict", "--quiet", "DEBIAN/md5sums", cwd=ROOT)
    files = sum(mode[0] == "-" for mode, _, _, _ in debian.contents(PACKAGE))
    lines = len((ROOT / "DEBIAN/md5sums").read_text(encoding="utf-8").splitlines())
    expect(lines == files, f"{lines} sums of {files} files")


def test_links_lead_somewhere():
    links = [path for mode, _, path, _ in debian.contents(PACKAGE) if mode[0] == "l"]
    expect(links, "no link")
    for path in links:
        expect((ROOT / path).exists(), f"{path} leads nowhere")


def test_documents():
    folder = ROOT / "usr/share/doc/twinlock"
    with gzip.open(folder / "changelog.Debian.gz", "rt", encoding="utf-8") as file:
        expect(file.read() == (SOURCE / "board/debian/changelog").read_text(encoding="utf-8"), "another changelog")
    copyright_ = (folder / "copyright").read_text(encoding="utf-8")
    for part in ("/usr/share/common-licenses/Apache-2.0", "Dan Vanderkam", "Permission is hereby granted"):
        expect(part in copyright_, f"copyright has no \"{part}\"")
    expect("@" not in copyright_.replace("<maintainers@", ""), copyright_)
    for name in ("install", "your-plant", "troubleshooting", "method", "retune", "security"):
        same = (folder / "docs" / f"{name}.md").read_bytes() == (SOURCE / f"docs/{name}.md").read_bytes()
        expect(same, f"{name}.md differs from the sources")


def test_no_path_of_the_build_in_it():
    for elf in [*elves(), SERVE_ROOT / "usr/bin/twinlock-serve"]:
        content = elf.read_bytes()
        for place in {str(SOURCE), str(BUILD), os.path.expanduser("~/")} - {"/root/"}:
            expect(place.encode() not in content, f"{elf.name} has {place} in it")


def sum_of(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_the_same_bytes_again():
    """The same for each user, time zone and time."""
    again = debian.make(TZ="Pacific/Auckland", LC_ALL="C.UTF-8", HOME="/nonexistent")
    expect(sum_of(again) == sum_of(PACKAGE), "another package in another time zone")
    serve = debian.make(name="twinlock-serve", TZ="Pacific/Auckland", LC_ALL="C.UTF-8", HOME="/nonexistent")
    expect(sum_of(serve) == sum_of(SERVE), "another twinlock-serve in another time zone")
    other = debian.make(SOURCE_DATE_EPOCH="1000000000")
    expect(sum_of(other) != sum_of(PACKAGE), "SOURCE_DATE_EPOCH changes nothing")
    times = {line.split()[3] for line in output_of("dpkg-deb", "--contents", other, env={**os.environ, "TZ": "UTC"})
             .splitlines()}
    expect(times == {"2001-09-09"}, f"{times}")


main()

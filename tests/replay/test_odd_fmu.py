#!/usr/bin/env python3
"""FMUs that deviate from FMI 2.0. They are used nevertheless, or the message has the remedy."""
import re
import stat
import zipfile

from hostile_fmu import LOCKED, config, make
from twinlock_test import NOT_LOCKED, expect, expect_line, main, run, scratch

BINARY = "lag.so"


def changed(description=None, rename=None, links=()):
    """The good FMU with another description (bytes to bytes), other names, or symbolic links."""
    path = scratch() / "odd.fmu"
    with zipfile.ZipFile(make("good")) as good, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as odd:
        for name in good.namelist():
            content = good.read(name)
            if name == "modelDescription.xml" and description is not None:
                content = description(content)
            odd.writestr(rename(name) if rename is not None else name, content)
        folder = next(name for name in good.namelist() if name.endswith(BINARY))[:-len(BINARY)]
        for name, target in links:
            entry = zipfile.ZipInfo(name.replace("FOLDER/", folder))
            entry.create_system = 3  # Unix
            entry.external_attr = (stat.S_IFLNK | 0o777) << 16
            odd.writestr(entry, target)
    return path


def again(name, reference, kind=b"Real"):
    """A further declaration of a parameter."""
    text = (b'<ScalarVariable name="%s" valueReference="%s" causality="parameter" variability="tunable"><%s start="1"/>'
            b"</ScalarVariable></ModelVariables>" % (name, reference, kind))
    return lambda xml: xml.replace(b"</ModelVariables>", text)


def expect_used(fmu, changes=LOCKED):
    for verb in ("check", "replay"):
        code, _, log = run((verb, config(fmu, changes)))
        expect(code in (0, NOT_LOCKED), f"{verb} ended with {code}\n{log}")
    return log


def expect_refused(parts, fmu, changes=LOCKED):
    code, _, log = run(("check", config(fmu, changes)))
    expect(code == 65, f"ended with {code}\n{log}")
    expect_line(log, parts)


def test_variables_declared_twice():
    """Equal declarations count once. Different ones are an error only if a configuration uses them."""
    expect_used(changed(again(b"T", b"2")))
    expect_used(changed(again(b"x_start", b"7")))
    expect_used(changed(again(b"T", b"2", b"Integer")), None)
    for reference, kind in ((b"3", b"Real"), (b"2", b"Integer")):
        expect_refused("synchronise.adjust.hostile.T|several variables|rename", changed(again(b"T", reference, kind)))


def test_a_start_value_that_is_no_number():
    """A Real that starts at NaN has no start value; other texts are errors."""
    def started(text):
        return changed(lambda xml: re.sub(b'(<Real[^>]*)start="[^"]*"', b'\\1start="%s"' % text, xml, count=1))
    expect_used(started(b"nan"))
    expect_refused("start|wrong|number", started(b"wrong"))


def test_an_encoding_of_windows():
    name = b'author="M\xfcller \x80"'
    author = b'author="twinlock"'
    expect_used(changed(lambda xml: xml.replace(b'"UTF-8"', b'"windows-1252"').replace(author, name)))
    expect_refused("line 4|encoding|UTF-8", changed(lambda xml: xml.replace(author, name)))
    expect_refused("line 1|encoding|UTF-8", changed(lambda xml: xml.replace(b'"UTF-8"', b'"EBCDIC-US"')))


def test_links_to_a_library():
    links = (("FOLDER/lag.so", "lag.so.1"), ("FOLDER/lag.so.1", "../../resources/lag.so.1.0"))
    expect_used(changed(rename=lambda name: "resources/lag.so.1.0" if name.endswith(BINARY) else name, links=links))
    expect_refused('"resources/out"|symbolic link|out of the FMU', changed(links=[("resources/out", "../../../etc/passwd")]))


def test_a_library_of_another_name():
    log = expect_used(changed(rename=lambda name: name.replace(BINARY, "Lag-20sim.so")))
    expect_line(log, "notice|modelIdentifier is lag|Lag-20sim.so")


if __name__ == "__main__":
    main()

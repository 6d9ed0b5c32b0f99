#!/usr/bin/env python3
"""Takes out of a Debian kernel package what the rig boots.

usage: kernel.py BOOT_IMAGE MODULES OUT

BOOT_IMAGE is vmlinuz, MODULES a tree that holds *.ko. Written are OUT/kernel, unpacked, since an emulated processor
takes seconds for it; OUT/modules/*.ko, the rig's drivers and what they need; and OUT/modules/order, their names in the
order in which they can be loaded, and OUT/modules/disk_order, those that come after them for a disk.
"""
import lzma
import re
import struct
import sys
from pathlib import Path

# In this order. What they depend on comes before them by itself.
# virtio_pci to overlay: the shares; the rest: the drivers under test. softdog is the first watchdog.
DRIVERS = ["virtio_pci", "virtio_console", "9pnet_virtio", "9p", "overlay", "configfs",
           "vcan", "can_raw", "kvaser_pci", "irq_sim", "gpio_sim", "softdog", "i6300esb"]
# What a disk with a file system needs beyond them, for a guest that has one. Nothing in ext4 names crc32c, but it asks for it.
DISK_DRIVERS = ["virtio_blk", "crc32c_generic", "ext4"]
OPTIONAL = {"kvaser_pci", "i6300esb"}  # not in every architecture's kernel


def unpacked(image):
    """The ELF file in an x86 boot image (boot protocol 2.08: payload_offset and payload_length), which QEMU starts by
    its PVH note. Any other image as it is."""
    if image[0x202:0x206] != b"HdrS":
        return image
    sectors = image[0x1F1] or 4
    offset, length = struct.unpack_from("<II", image, 0x248)
    payload = image[(sectors + 1) * 512 + offset:][:length]
    kernel = lzma.LZMADecompressor().decompress(payload)
    if not kernel.startswith(b"\x7fELF"):
        sys.exit("kernel.py: no ELF file in the boot image")
    return kernel


def name_of(path):
    return path.name.removesuffix(".ko").replace("-", "_")


def dependencies(content):
    found = re.search(rb"\0depends=([^\0]*)\0", content)
    return [name.replace("-", "_") for name in found[1].decode().split(",") if name] if found else []


def load_order(modules, wanted):
    """[(name, content)], each after what it depends on."""
    order, done = [], set()

    def visit(name):
        if name in done:
            return
        done.add(name)
        content = modules[name].read_bytes()
        for other in dependencies(content):
            if other in modules:  # else it is built in
                visit(other)
        order.append((name, content))

    for name in wanted:
        if name in modules or name not in OPTIONAL:
            visit(name)
    return order


def main():
    image, tree, out = map(Path, sys.argv[1:])
    modules = {name_of(path): path for path in sorted(tree.rglob("*.ko"))}
    order = load_order(modules, DRIVERS)
    whole = load_order(modules, DRIVERS + DISK_DRIVERS)
    (out / "modules").mkdir(parents=True)
    for name, content in whole:
        (out / "modules" / f"{name}.ko").write_bytes(content)
    for file, part in ("order", order), ("disk_order", whole[len(order):]):
        (out / "modules" / file).write_text("".join(f"{name}.ko\n" for name, _ in part), encoding="ascii")
    (out / "kernel").write_bytes(unpacked(image.read_bytes()))


if __name__ == "__main__":
    main()

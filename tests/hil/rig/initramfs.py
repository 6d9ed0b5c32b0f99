"""An initramfs: a cpio archive of the format newc, as the kernel unpacks it. Not compressed, since the emulated
processor would be longer at that than QEMU at reading it."""
import stat


def entry(name, mode, content, number):
    """One file of a cpio archive of the format newc, padded to four bytes."""
    encoded = name.encode() + b"\0"
    fields = [number, mode, 0, 0, 1, 0, len(content), 0, 0, 0, 0, len(encoded), 0]
    head = b"070701" + b"".join(b"%08X" % field for field in fields) + encoded
    return head + b"\0" * (-len(head) % 4) + content + b"\0" * (-len(content) % 4)


def archive(folders, files):
    """`files`: [(path, permissions, content)]"""
    entries = [(name, stat.S_IFDIR | 0o755, b"") for name in folders]
    entries += [(name, stat.S_IFREG | mode, content) for name, mode, content in files]
    entries.append(("TRAILER!!!", 0, b""))
    return b"".join(entry(*one, number) for number, one in enumerate(entries, 1))

"""Writes the manual page twinlock.json(5) from the schema: SCHEMA EXAMPLE VERSION PAGE.

The schema is the only source: each key with its type, range, default and description, and the snippets as examples.
"""
import json
import sys

HEAD = """.\\" Made from config/schema/twinlock-1.json by board/debian/configuration_manual.py.
.TH TWINLOCK.JSON 5 "" "twinlock {version}" "File Formats"
.ad l
.nh
.SH NAME
twinlock.json \\- configuration of twinlock
.SH DESCRIPTION
One JSON file in UTF\\-8 describes a twin: models, signals of the plant, what is corrected and compared.
.B twinlock init
writes a first one;
.B twinlock check
validates it. Times are in seconds; NAME stands for a name that you choose. Relative file names start at the folder of the file.
.PP
.I /usr/share/doc/twinlock/docs/reference/configuration.md
explains methods and limits.
.I /usr/share/twinlock/schema/twinlock\\-1.json
completes and checks the keys in an editor, if the file has
.BR \\(dq$schema\\(dq .
"""
TAIL = """.SH SEE ALSO
.BR twinlock (1)
"""
COLLECTIONS = {"components": "NAME", "sources": "NAME", "plant": "SIGNAL", "adjust": "VARIABLE", "match": "VARIABLE",
               "compare": "VARIABLE", "alarm": "VARIABLE", "columns": "COLUMN", "participants": "NAME"}


def escaped(text):
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + text if text[:1] in (".", "'") else text


class Page:
    def __init__(self, schema):
        self.schema = schema
        self.lines = []
        self.sections = []  # (place, node) that are still to be written
        self.written = {}  # reference → place of its section

    def resolved(self, node):
        reference = node.get("$ref", "").split("/")[-1]
        return {**self.resolved(self.schema["$defs"][reference]), **node} if reference else node

    def kind(self, node):
        """Type and range in words."""
        choices = node.get("enum") or ([node["const"]] if "const" in node else None)
        if choices:
            return ", ".join(map(json.dumps, choices))
        kinds = [node["type"]] if isinstance(node.get("type"), str) else node.get("type", [])
        kinds = kinds or [self.kind(self.resolved(one)) for one in node.get("anyOf", []) if "type" in self.resolved(one)]
        least = [f"{sign} {node[key]:g}" for key, sign in (("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤"),
                                                           ("exclusiveMaximum", "<")) if key in node]
        return ", ".join([" or ".join(dict.fromkeys(kinds)), *least]).strip(", ")

    def add_key(self, place, key, raw, required):
        node = self.resolved(raw)
        facts = [self.kind(node), "required" if required else f"default {json.dumps(node['default'])}" if "default" in node else ""]
        facts = f"({'; '.join(filter(None, facts))}) " if any(facts) else ""
        self.lines += [".TP", f".B {escaped(key)}", escaped(facts + node["description"])]
        inner = node.get("additionalProperties")
        child = f"{place}{key}"
        if "properties" not in node and isinstance(inner, dict):
            child, raw = f"{child}.{COLLECTIONS.get(key, 'NAME')}", inner
        branches = [raw] if "properties" in self.resolved(raw) else [node.get("then", {}), node.get("else", {})]
        self.sections += [(child, one) for one in branches if "properties" in self.resolved(one)]

    def write(self):
        self.sections = [("", self.schema)]
        while self.sections:
            place, raw = self.sections.pop(0)
            node = self.resolved(raw)
            reference = raw.get("$ref")
            if reference in self.written:
                continue
            self.written[reference or place] = place
            self.lines.append(f".SS {escaped(place)}" if place else ".SH KEYS")
            for key, value in node["properties"].items():
                self.add_key(place and f"{place}.", key, value, key in node.get("required", []))
            for snippet in node.get("defaultSnippets", []):
                self.lines += [".PP", escaped(snippet["label"]) + ":", ".PP", ".EX", escaped(json.dumps(snippet["body"])), ".EE"]
        return self.lines


def main():
    schema, example, version, page = sys.argv[1:]
    with open(schema, encoding="utf-8") as file:
        lines = Page(json.load(file)).write()
    with open(example, encoding="utf-8") as file:
        lines += [".SH EXAMPLE", ".EX", *map(escaped, file.read().splitlines()), ".EE"]
    with open(page, "w", encoding="utf-8") as file:
        file.write(HEAD.format(version=version) + "\n".join(lines) + "\n" + TAIL)


main()

"""Makes description.h of an FMU: what its modelDescription.xml says, as C. So its table of variables cannot say anything else.

Usage: description.py DESCRIPTION HEADER

HEADER has three macros, which TL_FMU_MODEL (model.h) makes a model of:

  TL_FMU_GUID
  TL_FMU_START_VALUES      initialises the members of the model's struct that have a start value
  TL_FMU_VARIABLES(model)  initialises a tl_fmu_variable for each ScalarVariable; `model` is the struct

A variable is the member of its name. What a model of ours cannot have, such as an enumeration, does not compile. The same
description always gives the same bytes. Needs nothing but Python's standard library.
"""

import json
import sys
import xml.etree.ElementTree as xml
from pathlib import Path

ROLES = {"input": "INPUT", "output": "RESULT", "local": "RESULT"}  # of a parameter: its variability
LITERALS = {  # of a start value
    "Real": lambda text: repr(float(text)),
    "Integer": lambda text: str(int(text)),
    "Boolean": lambda text: "fmi2True" if text in ("true", "1") else "fmi2False",
    "String": lambda text: json.dumps(text, ensure_ascii=False),
}


def start_value(variable):
    kind = variable[0]
    return f".{variable.get('name')} = {LITERALS[kind.tag](kind.get('start'))}"


def row(variable):
    role = ROLES.get(variable.get("causality"), variable.get("variability").upper())
    return (f"{{TL_FMU_{variable[0].tag.upper()}, {variable.get('valueReference')}, TL_FMU_{role}, "
            f"offsetof(model, {variable.get('name')})}}")


def macro(name, items):
    return f"#define {name} \\\n    " + ", \\\n    ".join(items) + "\n"


def main():
    description, header = sys.argv[1:]
    root = xml.parse(description).getroot()
    variables = root.findall("ModelVariables/ScalarVariable")
    started = [variable for variable in variables if "start" in variable[0].keys()]
    Path(header).write_text(f'#define TL_FMU_GUID "{root.get("guid")}"\n'
                            + macro("TL_FMU_START_VALUES", map(start_value, started))
                            + macro("TL_FMU_VARIABLES(model)", map(row, variables)), encoding="utf-8")


if __name__ == "__main__":
    main()

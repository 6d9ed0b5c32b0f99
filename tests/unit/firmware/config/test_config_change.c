/* Changes between two configurations: the kind and the right that each edit needs, whole parts,
 * full lists, names of files. Then random edits of the configurations in config/. */
#include <glob.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cjson/cJSON.h>
#include <unity.h>

#include "firmware/config/config_change.h"
#include "firmware/config/json_document.h"
#include "tests/support/config_text.h"
#include "tests/support/message.h"
#include "tests/support/random_numbers.h"

static const char *const base =
    "{\"twinlock\": 1, \"name\": \"motor\", \"step_s\": 0.01,\n"
    " \"components\": {\"motor\": {\"fmu\": \"motor.fmu\", \"set\": {\"R\": 1, \"table\": 2}, \"read\": [\"/srv/tables\"]}},\n"
    " \"sources\": {\"inverter\": {\"modbus_tcp\": {\"host\": \"10.0.0.5\", \"period_s\": 0.01}}},\n"
    " \"plant\": {\"omega\": {\"stale_s\": 0.5, \"modbus\": {\"source\": \"inverter\", \"unit_id\": 1, \"table\": \"input\", \"address\": 3}}},\n"
    " \"connect\": [[\"plant.omega\", \"motor.omega_measured\"]],\n"
    " \"synchronise\": {\"adjust\": {\"motor.load\": {\"step\": 0.1, \"nominal\": 0, \"max\": 5}},\n"
    "  \"match\": {\"motor.omega\": {\"to\": \"plant.omega\", \"tolerance\": 0.5, \"weight\": 2}},\n"
    "  \"budget\": {\"evaluations\": 100}},\n"
    " \"record\": {\"file\": \"run.db\", \"commit_s\": 1}, \"realtime\": {\"priority\": 10}}\n";

static tl_config_change change;
static tl_allowed_names allowed;
static tl_error error;

void setUp(void) {
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {
    tl_allowed_names_free(&allowed);
}

static void find(const char *before, const char *after) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        TL_OK, tl_config_change_find(before, strlen(before), after, strlen(after), &allowed, &change, &error),
        error.text);
}

static void expect_needs(tl_change_kind kind, tl_change_right right, size_t count, const char *about) {
    TEST_ASSERT_EQUAL_STRING_MESSAGE(tl_change_kinds[kind], tl_change_kinds[change.needs.kind], about);
    TEST_ASSERT_EQUAL_STRING_MESSAGE(tl_change_rights[right], tl_change_rights[change.needs.right], about);
    TEST_ASSERT_EQUAL_size_t_MESSAGE(count, change.count, about);
}

/* One replacement in the base, which is one edit. */
typedef struct one {
    const char *old;
    const char *new;
    tl_change_kind kind;
    tl_change_right right;
    const char *edit; /* "path: before > after"; before is empty if added, after if removed */
} one;

static const char *written(const tl_config_edit *edit) {
    static char text[512];
    (void)snprintf(text, sizeof text, "%s: %s > %s", edit->path, edit->before, edit->after);
    return text;
}

static void expect_one(const one *o) {
    char *edited = tl_test_replaced(base, o->old, o->new);
    TEST_ASSERT_NOT_NULL_MESSAGE(edited, o->old);
    find(base, edited);
    free(edited);
    expect_needs(o->kind, o->right, 1, o->edit);
    TEST_ASSERT_EQUAL_size_t(1, change.listed);
    TEST_ASSERT_EQUAL_INT(o->kind, change.edits[0].needs.kind);
    TEST_ASSERT_EQUAL_INT(o->right, change.edits[0].needs.right);
    TEST_ASSERT_EQUAL_STRING(o->edit, written(&change.edits[0]));
}

static void test_values_changed_in_place(void) {
    static const one changes[] = {
        {"\"tolerance\": 0.5", "\"tolerance\": 0.25", TL_CHANGE_IN_PLACE, TL_RIGHT_RETUNE,
         "synchronise.match.motor.omega.tolerance: 0.5 > 0.25"},
        {"\"weight\": 2", "\"weight\": 3", TL_CHANGE_IN_PLACE, TL_RIGHT_RETUNE,
         "synchronise.match.motor.omega.weight: 2 > 3"},
        {", \"weight\": 2", "", TL_CHANGE_IN_PLACE, TL_RIGHT_RETUNE, "synchronise.match.motor.omega.weight: 2 > "},
        {"\"weight\": 2", "\"weight\": 2, \"huber\": 3", TL_CHANGE_IN_PLACE, TL_RIGHT_RETUNE,
         "synchronise.match.motor.omega.huber:  > 3"},
        {"\"nominal\": 0", "\"nominal\": 1.5", TL_CHANGE_IN_PLACE, TL_RIGHT_RETUNE,
         "synchronise.adjust.motor.load.nominal: 0 > 1.5"},
        {"\"max\": 5", "\"max\": 4", TL_CHANGE_IN_PLACE, TL_RIGHT_RETUNE, "synchronise.adjust.motor.load.max: 5 > 4"},
        {"\"max\": 5", "\"max\": 5, \"approved\": 0.5", TL_CHANGE_IN_PLACE, TL_RIGHT_RETUNE,
         "synchronise.adjust.motor.load.approved:  > 0.5"},
        {"\"max\": 5", "\"max\": 5, \"penalty\": {\"rate\": 1}", TL_CHANGE_IN_PLACE, TL_RIGHT_RETUNE,
         "synchronise.adjust.motor.load.penalty:  > {\"rate\":1}"},
        {"\"evaluations\": 100", "\"evaluations\": 40", TL_CHANGE_IN_PLACE, TL_RIGHT_RETUNE,
         "synchronise.budget.evaluations: 100 > 40"},
        {"\"evaluations\": 100", "\"evaluations\": 100, \"time_s\": 0.004", TL_CHANGE_IN_PLACE, TL_RIGHT_RETUNE,
         "synchronise.budget.time_s:  > 0.004"},
        {"{\"evaluations\": 100}", "{}", TL_CHANGE_IN_PLACE, TL_RIGHT_RETUNE, "synchronise.budget.evaluations: 100 > "},
        {"\"match\": ", "\"margin\": 0.05, \"match\": ", TL_CHANGE_IN_PLACE, TL_RIGHT_RETUNE,
         "synchronise.margin:  > 0.05"},
        {"\"match\": ", "\"noise_floor\": 0, \"match\": ", TL_CHANGE_IN_PLACE, TL_RIGHT_RETUNE,
         "synchronise.noise_floor:  > 0"},
    };
    for (size_t i = 0; i < sizeof changes / sizeof changes[0]; i++) {
        expect_one(&changes[i]);
    }
}

static void test_values_that_need_a_new_twin(void) {
    static const one changes[] = {
        {"\"weight\": 2", "\"weight\": 0", TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE,
         "synchronise.match.motor.omega.weight: 2 > 0"},
        {"\"weight\": 2", "\"weight\": \"2\"", TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE,
         "synchronise.match.motor.omega.weight: 2 > \"2\""},
        {"\"tolerance\": 0.5, ", "", TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE,
         "synchronise.match.motor.omega.tolerance: 0.5 > "},
        {"\"nominal\": 0, ", "", TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE, "synchronise.adjust.motor.load.nominal: 0 > "},
        {"\"evaluations\": 100", "\"evaluations\": 101", TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE,
         "synchronise.budget.evaluations: 100 > 101"},
        {"\"evaluations\": 100", "\"evaluations\": true", TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE,
         "synchronise.budget.evaluations: 100 > true"},
    };
    for (size_t i = 0; i < sizeof changes / sizeof changes[0]; i++) {
        expect_one(&changes[i]);
    }
    find("{\"synchronise\": {\"match\": {\"a.y\": {\"weight\": 0}}}}", "{\"synchronise\": {\"match\": {\"a.y\": {}}}}");
    expect_needs(TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE, 1, "weight from 0 to its default");
}

/* A twin has room for at least 60 evaluations. More than it has room for need a new twin. */
static void test_evaluations(void) {
    static const struct {
        const char *before, *after;
        tl_change_kind kind;
    } cases[] = {
        {"{}", "{\"evaluations\": 60}", TL_CHANGE_IN_PLACE},
        {"{}", "{\"evaluations\": 61}", TL_CHANGE_NEW_TWIN},
        {"{\"evaluations\": 10}", "{\"evaluations\": 60}", TL_CHANGE_IN_PLACE},
        {"{\"evaluations\": 10}", "{}", TL_CHANGE_IN_PLACE},
        {"{\"evaluations\": 10}", "{\"evaluations\": 61}", TL_CHANGE_NEW_TWIN},
        {"{\"evaluations\": 500}", "{\"evaluations\": 499}", TL_CHANGE_IN_PLACE},
        {"{\"evaluations\": 500}", "{}", TL_CHANGE_IN_PLACE},
    };
    char before[100];
    char after[100];
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        (void)snprintf(before, sizeof before, "{\"synchronise\": {\"budget\": %s}}", cases[i].before);
        (void)snprintf(after, sizeof after, "{\"synchronise\": {\"budget\": %s}}", cases[i].after);
        find(before, after);
        expect_needs(cases[i].kind, TL_RIGHT_RETUNE, 1, cases[i].after);
    }
    find("{\"synchronise\": {}}", "{\"synchronise\": {\"budget\": {\"evaluations\": 61}}}");
    expect_needs(TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE, 1, "inside an added object");
}

static void test_changes_that_need_a_new_twin(void) {
    static const one changes[] = {
        {"\"R\": 1", "\"R\": 1.25", TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE, "components.motor.set.R: 1 > 1.25"},
        {"\"table\": 2", "\"table\": \"/srv/other\"", TL_CHANGE_NEW_TWIN, TL_RIGHT_BOX,
         "components.motor.set.table: 2 > \"/srv/other\""},
        {"\"table\": 2", "\"table\": \"other\"", TL_CHANGE_NEW_TWIN, TL_RIGHT_COMMISSION,
         "components.motor.set.table: 2 > \"other\""},
        {"motor.fmu", "/tmp/motor.fmu", TL_CHANGE_NEW_TWIN, TL_RIGHT_BOX,
         "components.motor.fmu: \"motor.fmu\" > \"/tmp/motor.fmu\""},
        {"motor.fmu", "pump.fmu", TL_CHANGE_NEW_TWIN, TL_RIGHT_BOX,
         "components.motor.fmu: \"motor.fmu\" > \"pump.fmu\""},
        {"\"read\": [\"/srv/tables\"]", "\"read\": []", TL_CHANGE_NEW_TWIN, TL_RIGHT_COMMISSION,
         "components.motor.read[0]: \"/srv/tables\" > "},
        {"[\"/srv/tables\"]", "[\"/etc\", \"/srv/tables\"]", TL_CHANGE_NEW_TWIN, TL_RIGHT_BOX,
         "components.motor.read[0]:  > \"/etc\""},
        {"\"connect\": [", "\"connect\": [[\"plant.omega\", \"motor.x\"], ", TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE,
         "connect[0]:  > [\"plant.omega\",\"motor.x\"]"},
        {"[[\"plant.omega\", \"motor.omega_measured\"]]", "[]", TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE,
         "connect[0]: [\"plant.omega\",\"motor.omega_measured\"] > "},
        {"\"match\": {", "\"match\": {\"motor.i\": {\"to\": \"plant.omega\", \"tolerance\": 1}, ", TL_CHANGE_NEW_TWIN,
         TL_RIGHT_RETUNE, "synchronise.match.motor.i:  > {\"to\":\"plant.omega\",\"tolerance\":1}"},
        {"\"components\": {", "\"components\": {\"pump\": {\"fmu\": \"pump.fmu\"}, ", TL_CHANGE_NEW_TWIN, TL_RIGHT_BOX,
         "components.pump:  > {\"fmu\":\"pump.fmu\"}"},
        {"\"components\": {", "\"components\": {\"pump\": {\"fmu\": \"pump.fmu\", \"sha256\": \"00\"}, ",
         TL_CHANGE_NEW_TWIN, TL_RIGHT_COMMISSION, "components.pump:  > {\"fmu\":\"pump.fmu\",\"sha256\":\"00\"}"},
        {" \"record\"", " \"delays\": \"measure\", \"record\"", TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE,
         "delays:  > \"measure\""},
    };
    for (size_t i = 0; i < sizeof changes / sizeof changes[0]; i++) {
        expect_one(&changes[i]);
    }
}

/* The process that reads the plant applies changed sources only after a restart. */
static void test_changed_sources_need_a_restart(void) {
    static const one changes[] = {
        {"\"plant\": {", "\"plant\": {\"i\": {\"csv\": {\"source\": \"inverter\"}}, ", TL_CHANGE_RESTART,
         TL_RIGHT_COMMISSION, "plant.i:  > {\"csv\":{\"source\":\"inverter\"}}"},
        {"\"plant\": {", "\"plant\": {\"i\": {\"gpio\": {\"line\": \"door\"}}, ", TL_CHANGE_RESTART,
         TL_RIGHT_COMMISSION, "plant.i:  > {\"gpio\":{\"line\":\"door\"}}"},
        {"10.0.0.5", "10.0.0.6", TL_CHANGE_RESTART, TL_RIGHT_COMMISSION,
         "sources.inverter.modbus_tcp.host: \"10.0.0.5\" > \"10.0.0.6\""},
        {"\"sources\": {", "\"sources\": {\"lines\": {\"gpio\": {}}, ", TL_CHANGE_RESTART, TL_RIGHT_COMMISSION,
         "sources.lines:  > {\"gpio\":{}}"},
        {"\"period_s\": 0.01", "\"period_s\": 0.1", TL_CHANGE_RESTART, TL_RIGHT_RETUNE,
         "sources.inverter.modbus_tcp.period_s: 0.01 > 0.1"},
    };
    for (size_t i = 0; i < sizeof changes / sizeof changes[0]; i++) {
        expect_one(&changes[i]);
    }
}

/* The limits of a reading need a new twin. The every_s of a Modbus signal also selects the polls,
 * so it needs a restart. */
static void test_limits_of_readings(void) {
    static const struct {
        const char *before, *after;
        tl_change_kind kind;
        tl_change_right right;
    } cases[] = {
        {"\"modbus\": {}, \"stale_s\": 1", "\"modbus\": {}, \"stale_s\": 2", TL_CHANGE_NEW_TWIN, TL_RIGHT_COMMISSION},
        {"\"modbus\": {}, \"max\": 1", "\"modbus\": {}", TL_CHANGE_NEW_TWIN, TL_RIGHT_COMMISSION},
        {"\"modbus\": {}", "\"modbus\": {}, \"initial\": 1", TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE},
        {"\"can\": {}, \"every_s\": 1", "\"can\": {}, \"every_s\": 2", TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE},
        {"\"can\": {}, \"every_s\": 1, \"stale_s\": 1", "\"can\": {}, \"every_s\": 1", TL_CHANGE_NEW_TWIN,
         TL_RIGHT_COMMISSION},
        {"\"modbus\": {}, \"every_s\": 1", "\"modbus\": {}", TL_CHANGE_RESTART, TL_RIGHT_RETUNE},
        {"\"modbus\": {}, \"every_s\": 1", "\"modbus\": {}, \"every_s\": 1, \"stale_s\": 1", TL_CHANGE_RESTART,
         TL_RIGHT_COMMISSION},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char text[2][128];
        (void)snprintf(text[0], sizeof text[0], "{\"plant\": {\"x\": {%s}}}", cases[i].before);
        (void)snprintf(text[1], sizeof text[1], "{\"plant\": {\"x\": {%s}}}", cases[i].after);
        find(text[0], text[1]);
        expect_needs(cases[i].kind, cases[i].right, 1, cases[i].after);
    }
}

static void test_changes_that_need_a_restart(void) {
    static const one changes[] = {
        {"\"name\": \"motor\"", "\"name\": \"pump\"", TL_CHANGE_RESTART, TL_RIGHT_RETUNE, "name: \"motor\" > \"pump\""},
        {"\"step_s\": 0.01", "\"step_s\": 0.02", TL_CHANGE_RESTART, TL_RIGHT_COMMISSION, "step_s: 0.01 > 0.02"},
        {"run.db", "/srv/run.db", TL_CHANGE_RESTART, TL_RIGHT_BOX, "record.file: \"run.db\" > \"/srv/run.db\""},
        {"\"commit_s\": 1", "\"commit_s\": 2", TL_CHANGE_RESTART, TL_RIGHT_RETUNE, "record.commit_s: 1 > 2"},
        {"\"priority\": 10", "\"priority\": 90", TL_CHANGE_RESTART, TL_RIGHT_COMMISSION, "realtime.priority: 10 > 90"},
        {" \"record\"", " \"unknown\": 1, \"record\"", TL_CHANGE_RESTART, TL_RIGHT_COMMISSION, "unknown:  > 1"},
    };
    for (size_t i = 0; i < sizeof changes / sizeof changes[0]; i++) {
        expect_one(&changes[i]);
    }
}

static void test_the_same(void) {
    find(base, base);
    expect_needs(TL_CHANGE_NONE, TL_RIGHT_RETUNE, 0, "");
    find("{\"a\": 5, \"b\": [1]}", "{ \"b\": [ 1.0 ],\n\"a\": 5e0 }");
    expect_needs(TL_CHANGE_NONE, TL_RIGHT_RETUNE, 0, "");
}

/* Tunings and sample buffers identify entries by position, so another order of these entries is a
 * change. */
static void test_order(void) {
    find("{\"synchronise\": {\"adjust\": {}, \"match\": {\"a.x\": {\"tolerance\": 1}, \"a.y\": {\"tolerance\": 2}}}}",
         "{\"synchronise\": {\"match\": {\"a.y\": {\"tolerance\": 2}, \"a.x\": {\"tolerance\": 3}}, \"adjust\": {}}}");
    expect_needs(TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE, 2, "");
    TEST_ASSERT_EQUAL_STRING("synchronise.match", change.edits[0].path);
    TL_EXPECT_PARTS("order", change.edits[0].after);
    TEST_ASSERT_EQUAL_STRING("synchronise.match.a.x.tolerance", change.edits[1].path);
    find("{\"synchronise\": {\"adjust\": {\"a.u\": {\"step\": 1}, \"a.v\": {\"step\": 1}}}}",
         "{\"synchronise\": {\"adjust\": {\"a.v\": {\"step\": 1}, \"a.u\": {\"step\": 1}}}}");
    expect_needs(TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE, 1, "");
    find("{\"plant\": {\"x\": {}, \"y\": {}}}", "{\"plant\": {\"y\": {}, \"x\": {}}}");
    expect_needs(TL_CHANGE_RESTART, TL_RIGHT_RETUNE, 1, "");
    find("{\"sources\": {\"x\": {}, \"y\": {}}}", "{\"sources\": {\"y\": {}, \"x\": {}}}");
    expect_needs(TL_CHANGE_NONE, TL_RIGHT_RETUNE, 0, "");
}

/* The list keeps the edits that need the most, not the first ones. */
static void test_a_full_list(void) {
    enum { MANY = 200, ROOM = MANY * 40 };
    char *before = calloc(ROOM, 1);
    char *after = calloc(ROOM, 1);
    TEST_ASSERT_TRUE(before != NULL && after != NULL);
    int a = snprintf(before, ROOM, "{\"components\": {\"m\": {\"set\": {\"k\": 0");
    int b = snprintf(after, ROOM, "{\"components\": {\"m\": {\"set\": {\"k\": 0");
    for (int i = 0; i < MANY; i++) {
        a += snprintf(before + a, ROOM - (size_t)a, ", \"k%03d\": 1", i);
        b += snprintf(after + b, ROOM - (size_t)b, ", \"k%03d\": %s", i, i == 150 ? "\"x\"" : "2");
    }
    (void)snprintf(before + a, ROOM - (size_t)a, "}}}, \"connect\": 1, \"step_s\": 1}");
    (void)snprintf(after + b, ROOM - (size_t)b, "}}}, \"connect\": 2, \"step_s\": 2}");
    find(before, after);
    free(before);
    free(after);
    expect_needs(TL_CHANGE_RESTART, TL_RIGHT_COMMISSION, MANY + 2, "");
    TEST_ASSERT_EQUAL_size_t(TL_CONFIG_EDITS, change.listed);
    TEST_ASSERT_EQUAL_STRING("components.m.set.k000", change.edits[0].path);
    TEST_ASSERT_EQUAL_STRING("components.m.set.k061", change.edits[TL_CONFIG_EDITS - 3].path);
    TEST_ASSERT_EQUAL_STRING("components.m.set.k150", change.edits[TL_CONFIG_EDITS - 2].path);
    TEST_ASSERT_EQUAL_STRING("step_s", change.edits[TL_CONFIG_EDITS - 1].path);
}

/* ---- names ---- */

static const char names_in_force[] =
    "{\"components\": {\"a\": {\"fmu\": \"/opt/a.fmu\", \"libraries\": [\"/lib/active.so\"]}},"
    " \"sources\": {\"s\": {\"csv\": {\"file\": \"/run/active\"}}}, \"record\": {\"file\": \"/srv/run.db\"}}";

/* Adds component b and replaces the file of the source. */
static void find_names(const char *component, const char *file) {
    char after[1024];
    (void)snprintf(
        after, sizeof after,
        "{\"components\": {\"a\": {\"fmu\": \"/opt/a.fmu\", \"libraries\": [\"/lib/active.so\"]}, \"b\": %s},"
        " \"sources\": {\"s\": {\"csv\": {\"file\": \"%s\"}}}, \"record\": {\"file\": \"/srv/run.db\"}}",
        component, file);
    find(names_in_force, after);
}

static void expect_barred(size_t count, const char *path, const char *found, tl_change_named names) {
    TEST_ASSERT_EQUAL_size_t_MESSAGE(count, change.privileged_count, path);
    TEST_ASSERT_EQUAL_INT_MESSAGE(count == 0 ? TL_RIGHT_COMMISSION : TL_RIGHT_BOX, change.needs.right, path);
    for (size_t i = 0; i < count && i < TL_CONFIG_PRIVILEGED; i++) {
        if (strcmp(change.privileged[i].path, path) == 0) {
            TEST_ASSERT_EQUAL_STRING(found, change.privileged[i].found);
            TEST_ASSERT_EQUAL_INT(names, change.privileged[i].names);
            return;
        }
    }
    TEST_ASSERT_EQUAL_size_t_MESSAGE(0, count, path);
}

/* Names in the list or in the active configuration are allowed, but only for their own kind. */
static void test_names_that_are_allowed(void) {
    const char *list = "# ours\n\nfile /run/listed\nlibrary /lib/listed.so\r\nfile /srv/two words\n";
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_allowed_names_add_list(&allowed, list, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_allowed_names_add_configuration(&allowed, names_in_force, &error),
                                  error.text);
    find_names("{\"fmu\": \"/opt/a.fmu\", \"libraries\": [\"/lib/active.so\", \"/lib/listed.so\"]}", "/run/listed");
    expect_barred(0, "", "", TL_NAMES_NOTHING);
    find_names("{\"fmu\": \"/opt/a.fmu\", \"read\": [\"/srv/two words\"], \"set\": {\"x\": \"/run/active\"}}",
               "/run/active");
    expect_barred(0, "", "", TL_NAMES_NOTHING);
    find_names("{\"fmu\": \"/opt/a.fmu\", \"libraries\": [\"/run/listed\"]}", "/run/active");
    expect_barred(1, "components.b.libraries[0]", "\"/run/listed\"", TL_NAMES_LIBRARY);
    find_names("{\"fmu\": \"/opt/a.fmu\", \"read\": [\"/lib/listed.so\", \"/srv\"]}", "/run/../run/listed");
    expect_barred(3, "components.b.read[1]", "\"/srv\"", TL_NAMES_FILE);
    expect_barred(3, "sources.s.csv.file", "\"/run/../run/listed\"", TL_NAMES_FILE);
    find_names("{\"fmu\": \"/opt/a.fmu\", \"unconfined\": true}", "/run/active");
    expect_barred(1, "components.b.unconfined", "true", TL_NAMES_NOTHING);
    tl_allowed_names_free(&allowed);
    find_names("{\"fmu\": \"/opt/a.fmu\"}", "/run/listed");
    expect_barred(2, "components.b.fmu", "\"/opt/a.fmu\"", TL_NAMES_FMU);
    expect_barred(2, "sources.s.csv.file", "\"/run/listed\"", TL_NAMES_FILE);
}

/* An installed FMU is allowed only with its hash. Without it, lacks_hash is true. */
static void test_installed_fmus(void) {
    find_names("{\"fmu\": \"b.fmu\"}", "/run/active");
    expect_barred(1, "components.b.fmu", "\"b.fmu\"", TL_NAMES_FMU);
    TEST_ASSERT_TRUE(change.privileged[0].lacks_hash);
    find_names("{\"sha256\": \"00\", \"fmu\": \"b.fmu\"}", "/run/active");
    expect_barred(0, "", "", TL_NAMES_NOTHING);
    find_names("{\"fmu\": \"b.fmu\", \"sha256\": \"00\", \"keep\": []}", "/run/active");
    expect_barred(0, "", "", TL_NAMES_NOTHING);
    find_names("{\"fmu\": \"../b.fmu\", \"sha256\": \"00\"}", "/run/active");
    expect_barred(1, "components.b.fmu", "\"../b.fmu\"", TL_NAMES_FMU);
    TEST_ASSERT_FALSE(change.privileged[0].lacks_hash);
}

/* All rejected names are counted, also those that are not listed. */
static void test_many_rejected_names(void) {
    find_names("{\"fmu\": \"/x\", \"read\": [\"/1\", \"/2\", \"/3\", \"/4\", \"/5\", \"/6\", \"/7\", \"/8\", \"/9\"]}",
               "/run/y");
    expect_barred(11, "components.b.fmu", "\"/x\"", TL_NAMES_FMU);
}

static void test_invalid_json(void) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_config_change_find("{", 1, "{}", 2, &allowed, &change, &error));
    TL_EXPECT_PARTS("configuration|JSON", error.text);
    TEST_ASSERT_FALSE_MESSAGE(tl_test_has_parts(error.text, "new"), error.text);
    TEST_ASSERT_EQUAL_INT(
        TL_BAD_DATA, tl_config_change_find("{\"step_s\": 1}", 13, "{\"step_s\": 01}", 14, &allowed, &change, &error));
    TL_EXPECT_PARTS("new|configuration|JSON", error.text);
    TEST_ASSERT_EQUAL_size_t(0, change.count);
    TEST_ASSERT_EQUAL_INT(TL_CHANGE_NONE, change.needs.kind);
}

/* ---- random edits of real configurations ---- */

enum { MOST_LEAVES = 4096, MOST_EDITS = 6 };

/* A value that is neither object nor array, and the object or array that contains it. */
typedef struct leaf {
    cJSON *item;
    cJSON *parent;
} leaf;

static leaf leaves[MOST_LEAVES];

static size_t find_leaves(cJSON *root) {
    tl_json_walk walk = {.depth = 0};
    size_t count = 0;
    for (cJSON *item = root; item != NULL; item = tl_json_walk_next(&walk, item)) {
        if (!cJSON_IsObject(item) && !cJSON_IsArray(item)) {
            TEST_ASSERT_LESS_THAN_size_t(MOST_LEAVES, count);
            leaves[count++] = (leaf){item, walk.around[walk.depth - 1]};
        }
    }
    return count;
}

typedef struct random_edit {
    size_t leaf;
    bool removes;
    double by;
} random_edit;

static void make_edit(const random_edit *edit) {
    const leaf *l = &leaves[edit->leaf];
    if (edit->removes && cJSON_IsObject(l->parent)) {
        cJSON_Delete(cJSON_DetachItemViaPointer(l->parent, l->item));
    } else if (cJSON_IsNumber(l->item)) {
        l->item->valuedouble += edit->by;
    } else if (cJSON_IsString(l->item)) {
        l->item->valuestring[0] = (char)(l->item->valuestring[0] == 'q' ? 'r' : 'q');
    } else {
        l->item->type ^= cJSON_True | cJSON_False;
    }
}

/* Returns the text of the configuration with these edits. The caller frees it. */
static char *edited_text(const cJSON *root, const random_edit *edits, size_t count) {
    cJSON *copy = cJSON_Duplicate(root, 1);
    (void)find_leaves(copy);
    for (size_t i = 0; i < count; i++) {
        make_edit(&edits[i]);
    }
    char *text = cJSON_Print(copy);
    cJSON_Delete(copy);
    TEST_ASSERT_NOT_NULL(text);
    return text;
}

static bool is_chosen(const random_edit *edits, size_t count, size_t leaf_index) {
    bool chosen = false;
    for (size_t i = 0; i < count; i++) {
        chosen = chosen || edits[i].leaf == leaf_index;
    }
    return chosen;
}

static size_t choose_edits(const cJSON *root, random_edit edits[MOST_EDITS], tl_test_random *random) {
    cJSON *copy = cJSON_Duplicate(root, 1);
    size_t all = find_leaves(copy);
    size_t wanted = tl_test_random_between(random, 1, MOST_EDITS);
    size_t count = 0;
    for (size_t i = 0; i < wanted; i++) {
        random_edit edit = {tl_test_random_below(random, all), tl_test_random_chance(random, 30),
                            tl_test_random_number(random, 1.0, 2.0)};
        const cJSON *item = leaves[edit.leaf].item;
        bool is_plain = !cJSON_IsString(item) || (item->valuestring[0] > 0 && item->valuestring[0] <= 0x7E);
        if (is_plain && !is_chosen(edits, count, edit.leaf)) {
            edits[count++] = edit;
        }
    }
    cJSON_Delete(copy);
    return count;
}

/* The reverse edit needs the same kind. Evaluations are the exception, because fewer need no new
 * twin. */
static void check_back(const char *text, const char *edited, const char *about) {
    tl_change_kind kind = change.needs.kind;
    bool counts_evaluations = strstr(change.edits[0].path, "evaluations") != NULL;
    find(edited, text);
    if (!counts_evaluations) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(kind, change.needs.kind, about);
    }
    TEST_ASSERT_EQUAL_size_t_MESSAGE(1, change.count, about);
}

static void check_edits(const cJSON *root, tl_test_random *random, const char *about) {
    random_edit edits[MOST_EDITS];
    tl_change_needs worst = {TL_CHANGE_NONE, TL_RIGHT_RETUNE, TL_NAMES_NOTHING};
    char *text = cJSON_Print(root);
    size_t count = choose_edits(root, edits, random);
    for (size_t i = 0; i < count; i++) {
        char *edited = edited_text(root, &edits[i], 1);
        find(text, edited);
        TEST_ASSERT_EQUAL_size_t_MESSAGE(1, change.count, about);
        TEST_ASSERT_NOT_EQUAL_INT_MESSAGE(TL_CHANGE_NONE, change.needs.kind, about);
        worst.kind = change.needs.kind > worst.kind ? change.needs.kind : worst.kind;
        worst.right = change.needs.right > worst.right ? change.needs.right : worst.right;
        check_back(text, edited, about);
        cJSON_free(edited);
    }
    char *edited = edited_text(root, edits, count);
    find(text, edited);
    expect_needs(worst.kind, worst.right, count, about);
    cJSON_free(edited);
    cJSON_free(text);
}

/* Reverses the order of the members of each object. */
static void reverse_members(cJSON *root) {
    tl_json_walk walk = {.depth = 0};
    for (cJSON *item = root; item != NULL; item = tl_json_walk_next(&walk, item)) {
        int count = cJSON_IsObject(item) ? cJSON_GetArraySize(item) : 0;
        for (int i = 0; i < count; i++) {
            cJSON_InsertItemInArray(item, 0, cJSON_DetachItemFromArray(item, i));
        }
    }
}

/* Counts those of match, adjust and plant that have several entries. */
static size_t count_places(const cJSON *root, tl_change_kind *kind) {
    const cJSON *synchronise = cJSON_GetObjectItemCaseSensitive(root, "synchronise");
    int matched = cJSON_GetArraySize(cJSON_GetObjectItemCaseSensitive(synchronise, "match"));
    int adjusted = cJSON_GetArraySize(cJSON_GetObjectItemCaseSensitive(synchronise, "adjust"));
    int signals = cJSON_GetArraySize(cJSON_GetObjectItemCaseSensitive(root, "plant"));
    *kind = signals > 1 ? TL_CHANGE_RESTART : matched > 1 || adjusted > 1 ? TL_CHANGE_NEW_TWIN : TL_CHANGE_NONE;
    return (matched > 1 ? 1U : 0U) + (adjusted > 1 ? 1U : 0U) + (signals > 1 ? 1U : 0U);
}

static void check_order_and_space(const cJSON *root, const char *about) {
    cJSON *copy = cJSON_Duplicate(root, 1);
    reverse_members(copy);
    char *text = cJSON_Print(root);
    char *turned = cJSON_PrintUnformatted(copy);
    TEST_ASSERT_NOT_EQUAL_INT(0, strcmp(text, turned));
    tl_change_kind kind = TL_CHANGE_NONE;
    size_t places = count_places(root, &kind);
    find(text, turned);
    expect_needs(kind, TL_RIGHT_RETUNE, places, about);
    cJSON_free(text);
    cJSON_free(turned);
    cJSON_Delete(copy);
}

static void test_random_edits(void) {
    glob_t files;
    TEST_ASSERT_EQUAL_INT(0, glob(TL_SOURCE_DIR "/config/*/*.json", 0, NULL, &files));
    TEST_ASSERT_GREATER_THAN_size_t(30, files.gl_pathc);
    size_t campaign = tl_test_campaign("TL_CHANGE_EDITS", 20);
    for (size_t i = 0; i < files.gl_pathc; i++) {
        char *text = tl_test_read_text(files.gl_pathv[i]);
        cJSON *root = cJSON_Parse(text);
        TEST_ASSERT_NOT_NULL_MESSAGE(root, files.gl_pathv[i]);
        check_order_and_space(root, files.gl_pathv[i]);
        for (size_t k = 0; k < campaign; k++) {
            tl_test_random random = {1000 * i + k};
            char about[500];
            (void)snprintf(about, sizeof about, "%s, seed %zu", files.gl_pathv[i], 1000 * i + k);
            check_edits(root, &random, about);
        }
        cJSON_Delete(root);
        free(text);
    }
    globfree(&files);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_values_changed_in_place);
    RUN_TEST(test_values_that_need_a_new_twin);
    RUN_TEST(test_evaluations);
    RUN_TEST(test_changes_that_need_a_new_twin);
    RUN_TEST(test_changed_sources_need_a_restart);
    RUN_TEST(test_limits_of_readings);
    RUN_TEST(test_changes_that_need_a_restart);
    RUN_TEST(test_the_same);
    RUN_TEST(test_order);
    RUN_TEST(test_a_full_list);
    RUN_TEST(test_names_that_are_allowed);
    RUN_TEST(test_installed_fmus);
    RUN_TEST(test_many_rejected_names);
    RUN_TEST(test_invalid_json);
    RUN_TEST(test_random_edits);
    return UNITY_END();
}

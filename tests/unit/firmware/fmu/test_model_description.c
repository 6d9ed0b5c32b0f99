/* modelDescription.xml: parsing, inheritance of declared types, and the message of each
 * rejection. */
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/fmu/model_description.h"
#include "tests/support/comma_locale.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"

#define ROOT                                                                                                           \
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"                                                                     \
    "<fmiModelDescription fmiVersion=\"2.0\" modelName=\"m\" guid=\"{g}\">\n"
#define CO_SIMULATION "<CoSimulation modelIdentifier=\"m\"/>\n"
#define END "</fmiModelDescription>\n"

static tl_arena arena;
static tl_model model;
static tl_error error;

void setUp(void) {
    tl_arena_init(&arena);
    memset(&model, 0xA5, sizeof model);
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {
    tl_arena_release(&arena);
}

static tl_status parse(const char *xml) {
    return tl_model_description_parse(xml, strlen(xml), "box.fmu", &arena, &model, &error);
}

static void expect_ok(const char *xml) {
    tl_status status = parse(xml);
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
}

/* The message has the FMU's name, the line, and the parts. */
static void expect_bad(const char *xml, unsigned line, const char *parts) {
    char where[80];
    (void)snprintf(where, sizeof where, "box.fmu|modelDescription.xml|line %u", line);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_BAD_DATA, parse(xml), xml);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, error.status);
    TL_EXPECT_PARTS(where, error.text);
    TL_EXPECT_PARTS(parts, error.text);
}

/* Returns a document with these variables, which begin in line 5. */
static const char *with_variables(const char *variables) {
    static char xml[4096];
    (void)snprintf(xml, sizeof xml, "%s%s<ModelVariables>\n%s\n</ModelVariables>\n" END, ROOT, CO_SIMULATION,
                   variables);
    return xml;
}

static const tl_variable *variable(const char *name) {
    const tl_variable *found = tl_model_variable(&model, name);
    TEST_ASSERT_NOT_NULL_MESSAGE(found, name);
    return found;
}

/* ---- Understood ------------------------------------------------------------------------------ */

static void test_root_and_capabilities(void) {
    expect_ok("<fmiModelDescription fmiVersion='2.0' modelName='Big &amp; m&#246;ller' guid='{8c4e}' "
              "generationTool='Tool 1'>"
              "<ModelExchange modelIdentifier='other'/>"
              "<CoSimulation modelIdentifier='motor_2' needsExecutionTool='true' "
              "canHandleVariableCommunicationStepSize='1' canRunAsynchronuously='true' "
              "canBeInstantiatedOnlyOncePerProcess='1' canNotUseMemoryManagementFunctions='true' "
              "canGetAndSetFMUstate=' true ' canSerializeFMUstate='true' maxOutputDerivativeOrder='1'>"
              "<SourceFiles><File name='a.c'/></SourceFiles></CoSimulation>"
              "<DefaultExperiment startTime='0' stepSize='1e-2'/><ModelVariables/></fmiModelDescription>");
    TEST_ASSERT_EQUAL_STRING("Big & m\xC3\xB6ller", model.name);
    TEST_ASSERT_EQUAL_STRING("motor_2", model.identifier);
    TEST_ASSERT_EQUAL_STRING("{8c4e}", model.guid);
    TEST_ASSERT_EQUAL_STRING("Tool 1", model.generation_tool);
    TEST_ASSERT_TRUE(model.capabilities.can_be_instantiated_only_once);
    TEST_ASSERT_TRUE(model.capabilities.can_get_and_set_state);
    TEST_ASSERT_TRUE(model.capabilities.can_serialize_state);
    TEST_ASSERT_EQUAL_size_t(0, model.variable_count);
}

static void test_capabilities_default_to_false(void) {
    const tl_capabilities none = {0};
    expect_ok(with_variables(""));
    TEST_ASSERT_EQUAL_MEMORY(&none, &model.capabilities, sizeof none);
    TEST_ASSERT_EQUAL_STRING("", model.generation_tool);
}

static void test_variables_of_all_types(void) {
    expect_ok(
        ROOT CO_SIMULATION
        "<TypeDefinitions><SimpleType name='E'><Enumeration><Item name='a' value='1'/></Enumeration>"
        "</SimpleType></TypeDefinitions><ModelVariables>"
        "<ScalarVariable name='r' valueReference='4294967295' description='a real' causality='input'>"
        "<Real start=' -1.5e3 ' min='-2e3' max='INF' nominal='10' unit='Pa'/></ScalarVariable>"
        "<ScalarVariable name='i' valueReference='0' causality='output' variability='discrete'>"
        "<Integer start='-2147483648' min='-5' max='7'/></ScalarVariable>"
        "<ScalarVariable name='b' valueReference='0' causality='parameter' variability='tunable'>"
        "<Boolean start='true'/></ScalarVariable>"
        "<ScalarVariable name='s' valueReference='0' variability='fixed'><String start='&lt;t&gt;'/></ScalarVariable>"
        "<ScalarVariable name='e' valueReference='9' variability='constant'>"
        "<Enumeration declaredType='E' start='3'/></ScalarVariable>"
        "</ModelVariables>" END);
    TEST_ASSERT_EQUAL_size_t(5, model.variable_count);
    const tl_variable *r = variable("r");
    TEST_ASSERT_EQUAL_PTR(&model.variables[0], r);
    TEST_ASSERT_EQUAL_STRING("a real", r->description);
    TEST_ASSERT_EQUAL_UINT32(4294967295U, r->reference);
    TEST_ASSERT_EQUAL_INT(TL_REAL, r->type);
    TEST_ASSERT_EQUAL_INT(TL_INPUT, r->causality);
    TEST_ASSERT_TRUE(r->has_start);
    TEST_ASSERT_EQUAL_INT(TL_REAL, r->start.type);
    TEST_ASSERT_EQUAL_DOUBLE(-1500, r->start.real);
    TEST_ASSERT_EQUAL_DOUBLE(-2000, r->minimum);
    TEST_ASSERT_TRUE(isinf(r->maximum) && r->maximum > 0);
    TEST_ASSERT_EQUAL_DOUBLE(10, r->nominal);
    TEST_ASSERT_EQUAL_STRING("Pa", r->unit->name);
    TEST_ASSERT_EQUAL_INT(INT32_MIN, variable("i")->start.integer);
    TEST_ASSERT_EQUAL_DOUBLE(-5, variable("i")->minimum);
    TEST_ASSERT_EQUAL_DOUBLE(7, variable("i")->maximum);
    TEST_ASSERT_EQUAL_INT(1, variable("b")->start.integer);
    TEST_ASSERT_EQUAL_INT(TL_BOOLEAN, variable("b")->start.type);
    TEST_ASSERT_EQUAL_STRING("<t>", variable("s")->start.text);
    TEST_ASSERT_EQUAL_INT(TL_ENUMERATION, variable("e")->type);
    TEST_ASSERT_EQUAL_INT(3, variable("e")->start.integer);
    TEST_ASSERT_NULL(tl_model_variable(&model, "x"));
}

static void test_default_experiment(void) {
    static const struct {
        const char *attributes;
        double start, stop;
    } cases[] = {
        {"startTime='64800' stopTime='1e5'", 64800, 1e5},
        {"startTime='-1.5'", -1.5, (double)NAN},
        {"stepSize='1'", (double)NAN, (double)NAN},
        {"startTime='' stopTime='INF'", (double)NAN, (double)NAN}, /* no reason to reject the FMU */
        {"startTime='NaN' stopTime='x'", (double)NAN, (double)NAN},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char xml[512];
        (void)snprintf(xml, sizeof xml, ROOT CO_SIMULATION "<DefaultExperiment %s/><ModelVariables/>" END,
                       cases[i].attributes);
        expect_ok(xml);
        TEST_ASSERT_EQUAL_DOUBLE(cases[i].start, model.start_time);
        TEST_ASSERT_EQUAL_DOUBLE(cases[i].stop, model.stop_time);
    }
}

static void expect_items(const char *items, const char *limits, double minimum, double maximum, uint64_t bits) {
    char xml[1024];
    (void)snprintf(xml, sizeof xml,
                   ROOT CO_SIMULATION
                   "<TypeDefinitions><SimpleType name='E'><Enumeration>%s</Enumeration></SimpleType></TypeDefinitions>"
                   "<ModelVariables><ScalarVariable name='e' valueReference='0' causality='input'>"
                   "<Enumeration declaredType='E' %s start='1'/></ScalarVariable></ModelVariables>" END,
                   items, limits);
    expect_ok(xml);
    TEST_ASSERT_EQUAL_DOUBLE(minimum, variable("e")->minimum);
    TEST_ASSERT_EQUAL_DOUBLE(maximum, variable("e")->maximum);
    TEST_ASSERT_EQUAL_HEX64(bits, variable("e")->items);
}

static void test_items(void) {
    static const char *const items = "<Item name='c' value='5'/><Item name='a' value='1'/><Item name='b' value='3'/>";
    expect_items(items, "", 1, 5, 0x15);
    expect_items(items, "min='2'", 2, 5, 0x0A);
    expect_items(items, "min='-9' max='4'", 1, 4, 0x15);
    expect_items(items, "min='7'", 7, (double)INFINITY, 0); /* contradicts them */
    expect_items("<Item name='a' value='-2'/>", "", -2, -2, 1);
    expect_items("<Item name='a' value='-1'/><Item name='b' value='62'/>", "", -1, 62, UINT64_C(1) << 63 | 1);
    expect_items("<Item name='a' value='0'/><Item name='b' value='64'/><Item name='c' value='1'/>", "", 0, 64, 0);
    expect_items("<Item name='a' value='-2147483648'/><Item name='b' value='2147483647'/>", "", INT32_MIN, INT32_MAX,
                 0);
    expect_items("", "", -(double)INFINITY, (double)INFINITY, 0);
}

static void test_optional_attributes(void) {
    expect_ok(with_variables("<ScalarVariable name='r' valueReference='1'><Real/></ScalarVariable>"));
    const tl_variable *r = variable("r");
    TEST_ASSERT_EQUAL_STRING("", r->description);
    TEST_ASSERT_EQUAL_INT(TL_LOCAL, r->causality);
    TEST_ASSERT_EQUAL_INT(TL_CONTINUOUS, r->variability);
    TEST_ASSERT_EQUAL_INT(TL_INITIAL_CALCULATED, r->initial);
    TEST_ASSERT_NULL(r->unit);
    TEST_ASSERT_FALSE(r->has_start);
    TEST_ASSERT_TRUE(isinf(r->minimum) && r->minimum < 0);
    TEST_ASSERT_TRUE(isinf(r->maximum) && r->maximum > 0);
    TEST_ASSERT_EQUAL_DOUBLE(1, r->nominal);
}

static void test_defaults_of_variability_and_initial(void) {
    static const struct {
        const char *attributes;
        const char *type;
        tl_variability variability;
        tl_initial initial;
    } cases[] = {
        {"causality='parameter'", "Real", TL_FIXED, TL_INITIAL_EXACT},
        {"causality='parameter' variability='tunable'", "Real", TL_TUNABLE, TL_INITIAL_EXACT},
        {"causality='calculatedParameter'", "Integer", TL_FIXED, TL_INITIAL_CALCULATED},
        {"causality='input'", "Real", TL_CONTINUOUS, TL_INITIAL_NONE},
        {"causality='input' initial='exact'", "Boolean", TL_DISCRETE, TL_INITIAL_NONE},
        {"causality='independent'", "Real", TL_CONTINUOUS, TL_INITIAL_NONE},
        {"causality='output'", "Integer", TL_DISCRETE, TL_INITIAL_CALCULATED},
        {"causality='output' initial='exact'", "Real", TL_CONTINUOUS, TL_INITIAL_EXACT},
        {"causality='output' variability='constant'", "Real", TL_CONSTANT, TL_INITIAL_EXACT},
        {"causality='local' initial='approx'", "String", TL_DISCRETE, TL_INITIAL_APPROX},
        {"causality='local' variability='fixed'", "Real", TL_FIXED, TL_INITIAL_CALCULATED},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char xml[256];
        (void)snprintf(xml, sizeof xml, "<ScalarVariable name='v' valueReference='1' %s><%s/></ScalarVariable>",
                       cases[i].attributes, cases[i].type);
        expect_ok(with_variables(xml));
        TEST_ASSERT_EQUAL_INT_MESSAGE(cases[i].variability, variable("v")->variability, cases[i].attributes);
        TEST_ASSERT_EQUAL_INT_MESSAGE(cases[i].initial, variable("v")->initial, cases[i].attributes);
    }
}

static void test_units(void) {
    expect_ok(
        ROOT CO_SIMULATION
        "<UnitDefinitions>"
        "<Unit name='rpm'><BaseUnit s='-1' rad='1' factor='0.10471975511965977'/></Unit>"
        "<Unit name='degC'><BaseUnit K='1' offset='273.15'/><DisplayUnit name='degF' factor='1.8' offset='32'/></Unit>"
        "<Unit name='V'><BaseUnit kg='1' m='2' s='-3' A='-1' mol='4' cd='5'/></Unit>"
        "<Unit name='pieces'/><Unit name=''><BaseUnit/></Unit></UnitDefinitions><ModelVariables>"
        "<ScalarVariable name='a' valueReference='1'><Real unit='rpm'/></ScalarVariable>"
        "<ScalarVariable name='b' valueReference='2'><Real unit='bar'/></ScalarVariable>"
        "<ScalarVariable name='c' valueReference='3'><Real unit='bar'/></ScalarVariable>"
        "<ScalarVariable name='d' valueReference='4'><Real unit=''/></ScalarVariable>"
        "</ModelVariables>" END);
    TEST_ASSERT_EQUAL_size_t(6, model.unit_count);
    const tl_unit *rpm = tl_model_unit(&model, "rpm");
    TEST_ASSERT_EQUAL_PTR(rpm, variable("a")->unit);
    TEST_ASSERT_TRUE(rpm->has_base);
    TEST_ASSERT_EQUAL_DOUBLE(0.10471975511965977, rpm->factor);
    TEST_ASSERT_EQUAL_DOUBLE(0, rpm->offset);
    const int speed[8] = {0, 0, -1, 0, 0, 0, 0, 1};
    TEST_ASSERT_EQUAL_INT_ARRAY(speed, rpm->exponents, 8);
    const tl_unit *celsius = tl_model_unit(&model, "degC");
    TEST_ASSERT_EQUAL_DOUBLE(1, celsius->factor);
    TEST_ASSERT_EQUAL_DOUBLE(273.15, celsius->offset);
    const int all[8] = {1, 2, -3, -1, 0, 4, 5, 0};
    TEST_ASSERT_EQUAL_INT_ARRAY(all, tl_model_unit(&model, "V")->exponents, 8);
    TEST_ASSERT_FALSE(tl_model_unit(&model, "pieces")->has_base);
    const tl_unit *bar = variable("b")->unit; /* not defined in <UnitDefinitions> */
    TEST_ASSERT_EQUAL_PTR(bar, variable("c")->unit);
    TEST_ASSERT_EQUAL_PTR(bar, tl_model_unit(&model, "bar"));
    TEST_ASSERT_FALSE(bar->has_base);
    TEST_ASSERT_NULL(variable("d")->unit);
    TEST_ASSERT_NULL(tl_model_unit(&model, "K"));
}

static void test_declared_types_are_inherited(void) {
    expect_ok(ROOT CO_SIMULATION
              "<TypeDefinitions>"
              "<SimpleType name='Speed'><Real unit='rad/s' min='-10' max='10' nominal='5'/></SimpleType>"
              "<SimpleType name='Count'><Integer min='0' max='9'/></SimpleType></TypeDefinitions><ModelVariables>"
              "<ScalarVariable name='a' valueReference='1'><Real declaredType='Speed'/></ScalarVariable>"
              "<ScalarVariable name='b' valueReference='2'><Real declaredType='Speed' unit='rpm' max='99' nominal='0'/>"
              "</ScalarVariable>"
              "<ScalarVariable name='c' valueReference='3'><Integer declaredType='Count' min='-1'/></ScalarVariable>"
              "</ModelVariables>" END);
    TEST_ASSERT_EQUAL_STRING("rad/s", variable("a")->unit->name);
    TEST_ASSERT_EQUAL_DOUBLE(-10, variable("a")->minimum);
    TEST_ASSERT_EQUAL_DOUBLE(10, variable("a")->maximum);
    TEST_ASSERT_EQUAL_DOUBLE(5, variable("a")->nominal);
    TEST_ASSERT_EQUAL_STRING("rpm", variable("b")->unit->name);
    TEST_ASSERT_EQUAL_DOUBLE(-10, variable("b")->minimum);
    TEST_ASSERT_EQUAL_DOUBLE(99, variable("b")->maximum);
    TEST_ASSERT_EQUAL_DOUBLE(1, variable("b")->nominal);
    TEST_ASSERT_EQUAL_DOUBLE(-1, variable("c")->minimum);
    TEST_ASSERT_EQUAL_DOUBLE(9, variable("c")->maximum);
}

static void test_many_variables_and_aliases(void) {
    enum { COUNT = 3000, EACH = 100 };
    char *xml = malloc((size_t)COUNT * EACH + 400);
    TEST_ASSERT_NOT_NULL(xml);
    size_t used = (size_t)sprintf(xml, ROOT CO_SIMULATION "<ModelVariables>");
    for (int i = 0; i < COUNT; i++) { /* all with the same value reference */
        used += (size_t)sprintf(xml + used,
                                "<ScalarVariable name='v%d' valueReference='7'><Real unit='u%d'/>"
                                "</ScalarVariable>\n",
                                i, i % 200);
    }
    (void)sprintf(xml + used, "</ModelVariables>" END);
    tl_status status = parse(xml);
    free(xml);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
    TEST_ASSERT_EQUAL_size_t(COUNT, model.variable_count);
    TEST_ASSERT_EQUAL_size_t(200, model.unit_count);
    for (int i = 0; i < COUNT; i++) { /* in the order of the document, each with its unit */
        char name[16];
        (void)snprintf(name, sizeof name, "v%d", i);
        TEST_ASSERT_EQUAL_STRING(name, model.variables[i].name);
        (void)snprintf(name, sizeof name, "u%d", i % 200);
        TEST_ASSERT_EQUAL_STRING(name, model.variables[i].unit->name);
    }
}

static void test_unknown_elements_are_skipped(void) {
    expect_ok(ROOT CO_SIMULATION
              "<LogCategories><Category name='c'/></LogCategories>"
              "<VendorAnnotations><Tool name='t'><ModelVariables><ScalarVariable/></ModelVariables>"
              "<CoSimulation/><fmiModelDescription/></Tool></VendorAnnotations>"
              "<ModelVariables><ScalarVariable name='v' valueReference='1' later='yes'><Real/>"
              "<Annotations><Tool name='t'><Real start='no'/></Tool></Annotations></ScalarVariable></ModelVariables>"
              "<ModelStructure><Outputs><Unknown index='1'/></Outputs></ModelStructure>" END);
    TEST_ASSERT_EQUAL_size_t(1, model.variable_count);
}

static void test_the_rounded_largest_double_is_no_limit(void) {
    expect_ok(with_variables("<ScalarVariable name='v' valueReference='1'>"
                             "<Real min='-1.79769313486232E+308' max='1.79769313486232E+308'/></ScalarVariable>"));
    TEST_ASSERT_TRUE(isinf(variable("v")->minimum));
    TEST_ASSERT_TRUE(isinf(variable("v")->maximum));
}

static void test_other_encodings(void) {
    expect_ok("\xEF\xBB\xBF<?xml version='1.0'?><fmiModelDescription fmiVersion='2.0' modelName='n' guid='g'>"
              "<CoSimulation modelIdentifier='m'/><ModelVariables/></fmiModelDescription>");
    expect_ok("<?xml version='1.0' encoding='ISO-8859-1'?><fmiModelDescription fmiVersion='2.0' modelName='m\xF6' "
              "guid='g'><CoSimulation modelIdentifier='m'/><ModelVariables/></fmiModelDescription>");
    TEST_ASSERT_EQUAL_STRING("m\xC3\xB6", model.name);
}

static void expect_name(const char *encoding, const char *bytes, const char *name) {
    char xml[400];
    (void)snprintf(xml, sizeof xml,
                   "<?xml version='1.0' encoding='%s'?><fmiModelDescription fmiVersion='2.0' modelName='%s' guid='g'>"
                   "<CoSimulation modelIdentifier='m'/><ModelVariables/></fmiModelDescription>",
                   encoding, bytes);
    expect_ok(xml);
    TEST_ASSERT_EQUAL_STRING(name, model.name);
}

static void test_encodings_of_windows(void) {
    expect_name("windows-1252", "\x80 \xB0\x43 \xD6l", "\xE2\x82\xAC \xC2\xB0\x43 \xC3\x96l");
    expect_name("Windows-1250", "\x9Elut\xFD", "\xC5\xBElut\xC3\xBD");
    expect_name("windows-1251", "\xE2\xEE\xE4\xE0", "\xD0\xB2\xD0\xBE\xD0\xB4\xD0\xB0");
    expect_name("cp1252", "\x85", "\xE2\x80\xA6");
    expect_name("ISO-8859-15", "\xA4", "\xE2\x82\xAC");
    expect_name("GBK", "\xB5\xE7\xBB\xFA x", "\xE7\x94\xB5\xE6\x9C\xBA x");
    expect_name("GB2312", "\xB5\xE7\xBB\xFA", "\xE7\x94\xB5\xE6\x9C\xBA");
    expect_name("Shift_JIS", "\x93\x64 \xB1", "\xE9\x9B\xBB \xEF\xBD\xB1");
    expect_name("windows-31J", "\x93\x64", "\xE9\x9B\xBB");
    expect_name("EUC-JP", "\xC5\xC5\x8F\xB0\xA1", "\xE9\x9B\xBB\xE4\xB8\x82");
    expect_name("Big5", "\xB9\x71", "\xE9\x9B\xBB");
}

static void test_encodings_that_are_refused(void) {
    expect_bad("<?xml version='1.0' encoding='windows-1252'?>\n<fmiModelDescription modelName='\x81'/>", 2,
               "XML|UTF-8");
    expect_bad("<?xml version='1.0' encoding='GBK'?>\n<fmiModelDescription modelName='\xB5'/>", 2, "XML");
    expect_bad("<?xml version='1.0' encoding='UTF-7'?>\n<x/>", 1, "encoding|UTF-8");
    expect_bad("<?xml version='1.0' encoding='ISO-2022-JP'?>\n<x/>", 1, "encoding|UTF-8");
    expect_bad("<?xml version='1.0' encoding='EBCDIC-US'?>\n<x/>", 1, "encoding|UTF-8");
    expect_bad("<?xml version='1.0' encoding='windows-9999'?>\n<x/>", 1, "encoding|UTF-8");
}

/* ---- Refused --------------------------------------------------------------------------------- */

static void test_versions(void) {
    expect_bad("<?xml version='1.0'?>\n\n<fmiModelDescription fmiVersion='1.0' modelName='m' modelIdentifier='m' "
               "guid='g'/>",
               3, "FMI 1.0|FMI 2.0");
    expect_bad("<fmiModelDescription fmiVersion='3.0' modelName='m' instantiationToken='t'/>", 1, "FMI 3.0|FMI 2.0");
    expect_bad("<fmiModelDescription modelName='m' guid='g'/>", 1, "fmiVersion");
    expect_bad("<html><body/></html>", 1, "<html>|<fmiModelDescription>");
}

static void test_mandatory_parts(void) {
    expect_bad("<fmiModelDescription fmiVersion='2.0' guid='g'/>", 1, "<fmiModelDescription>|modelName");
    expect_bad("<fmiModelDescription fmiVersion='2.0' modelName='m'/>", 1, "<fmiModelDescription>|guid");
    expect_bad(ROOT "<CoSimulation/>\n" END, 3, "<CoSimulation>|modelIdentifier");
    expect_bad(ROOT "<ModelExchange modelIdentifier='m'/><ModelVariables/>" END, 4, "Model Exchange|Co-Simulation");
    expect_bad(ROOT "<ModelVariables/>" END, 4, "<CoSimulation>|FMI 2.0|Co-Simulation");
    expect_bad(ROOT CO_SIMULATION END, 5, "<ModelVariables>");
    expect_bad(ROOT CO_SIMULATION CO_SIMULATION END, 4, "<CoSimulation>|second");
    expect_bad(ROOT "<UnitDefinitions><Unit/></UnitDefinitions>" END, 3, "<Unit>|name");
    expect_bad(ROOT "<TypeDefinitions><SimpleType/></TypeDefinitions>" END, 3, "<SimpleType>|name");
    expect_bad(with_variables("<ScalarVariable valueReference='1'><Real/></ScalarVariable>"), 5,
               "<ScalarVariable>|name");
    expect_bad(with_variables("\n<ScalarVariable name='v'><Real/></ScalarVariable>"), 6,
               "<ScalarVariable>|valueReference");
    expect_bad(with_variables("<ScalarVariable name='v' valueReference='1'><Enumeration/></ScalarVariable>"), 5,
               "<Enumeration>|declaredType");
}

static void test_identifiers_stay_in_their_folder(void) {
    expect_bad(ROOT "<CoSimulation modelIdentifier='../../m'/>" END, 3, "modelIdentifier|\"../../m\"");
    expect_bad(ROOT "<CoSimulation modelIdentifier='a/m'/>" END, 3, "modelIdentifier|\"a/m\"");
    expect_bad(ROOT "<CoSimulation modelIdentifier='a\\m'/>" END, 3, "modelIdentifier|\"a\\m\"");
    expect_bad(ROOT "<CoSimulation modelIdentifier=''/>" END, 3, "modelIdentifier|\"\"");
    expect_bad(ROOT "<CoSimulation modelIdentifier='..'/>" END, 3, "modelIdentifier|\"..\"");
    expect_bad(ROOT "<CoSimulation modelIdentifier='m&#10;m'/>" END, 3, "modelIdentifier|\"m\\x0Am\"");
}

static void test_types_of_variables(void) {
    expect_bad(with_variables("<ScalarVariable name='speed' valueReference='1'>\n\n</ScalarVariable>"), 5,
               "variable|\"speed\"|type");
    expect_bad(with_variables("<ScalarVariable name='v' valueReference='1'><Real/>\n<Integer/></ScalarVariable>"), 6,
               "<Integer>|second");
    expect_bad(ROOT "<TypeDefinitions><SimpleType name='T'/></TypeDefinitions>" END, 3, "type|\"T\"|<Real>|<Integer>");
    expect_bad(with_variables("<ScalarVariable name='v' valueReference='1'><Real declaredType='T'/></ScalarVariable>"),
               5, "declaredType|\"T\"|\"v\"|<TypeDefinitions>");
    expect_bad(ROOT CO_SIMULATION
               "<TypeDefinitions><SimpleType name='T'><Real/></SimpleType></TypeDefinitions>"
               "<ModelVariables><ScalarVariable name='v' valueReference='1'><Integer declaredType='T'/>"
               "</ScalarVariable></ModelVariables>" END,
               4, "declaredType|\"T\"|\"v\"");
    TEST_ASSERT_FALSE(tl_test_has_parts(error.text, "<TypeDefinitions>"));
}

static void test_numbers(void) {
    static const struct {
        const char *type;
        const char *parts;
    } cases[] = {
        {"<Real start='INF'/>", "start|\"INF\"|<Real>|finite"},
        {"<Real start='-INF'/>", "start|\"-INF\"|finite"},
        {"<Real start='Not'/>", "start|\"Not\"|<Real>|number"},
        {"<Real start='1e999'/>", "start|\"1e999\"|finite"},
        {"<Real start='1,5'/>", "start|\"1,5\""},
        {"<Real start='0x10'/>", "start|\"0x10\"|number"},
        {"<Real start=''/>", "start|\"\"|number"},
        {"<Real start='1.5 V'/>", "start|\"1.5 V\"|number"},
        {"<Real start='infinity'/>", "start|\"infinity\"|number"},
        {"<Real min='NaN'/>", "min|\"NaN\""},
        {"<Real nominal='INF'/>", "nominal|\"INF\""},
        {"<Real min='2' max='1'/>", "variable|\"v\"|min|2|max|1"},
        {"<Integer start='1.0'/>", "start|\"1.0\"|<Integer>|32 bits"},
        {"<Integer start='2147483648'/>", "start|\"2147483648\"|32 bits"},
        {"<Boolean start='True'/>", "start|\"True\"|<Boolean>|true|false"},
        {"<Boolean start='2'/>", "start|\"2\"|true|false"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char xml[256];
        (void)snprintf(xml, sizeof xml, "<ScalarVariable name='v' valueReference='1'>%s</ScalarVariable>",
                       cases[i].type);
        expect_bad(with_variables(xml), 5, cases[i].parts);
    }
    expect_bad(with_variables("<ScalarVariable name='v' valueReference='-1'><Real/></ScalarVariable>"), 5,
               "valueReference|\"-1\"|<ScalarVariable>|unsigned");
    expect_bad(with_variables("<ScalarVariable name='v' valueReference='4294967296'><Real/></ScalarVariable>"), 5,
               "valueReference|\"4294967296\"|32 bits");
    expect_bad(ROOT "<UnitDefinitions><Unit name='u'><BaseUnit m='0.5'/></Unit></UnitDefinitions>" END, 3,
               "m|\"0.5\"|<BaseUnit>");
    expect_bad(ROOT "<UnitDefinitions><Unit name='u'><BaseUnit factor='0'/></Unit></UnitDefinitions>" END, 3,
               "factor|\"0\"|<BaseUnit>");
    expect_bad(ROOT "<UnitDefinitions><Unit name='u'><BaseUnit/><BaseUnit/></Unit></UnitDefinitions>" END, 3,
               "<BaseUnit>|second|\"u\"");
    expect_bad(ROOT "<CoSimulation modelIdentifier='m' canGetAndSetFMUstate='yes'/>" END, 3,
               "canGetAndSetFMUstate|\"yes\"|<CoSimulation>|true|false");
}

static void test_words(void) {
    expect_bad(with_variables("<ScalarVariable name='v' valueReference='1' causality='Input'><Real/></ScalarVariable>"),
               5, "causality|\"Input\"|<ScalarVariable>|parameter|calculatedParameter|input|output|local|independent");
    expect_bad(
        with_variables("<ScalarVariable name='v' valueReference='1' variability='none'><Real/></ScalarVariable>"), 5,
        "variability|\"none\"|constant|fixed|tunable|discrete|continuous");
    expect_bad(with_variables("<ScalarVariable name='v' valueReference='1' initial='none'><Real/></ScalarVariable>"), 5,
               "initial|\"none\"|exact|approx|calculated");
}

static void test_names_given_twice(void) {
    expect_bad(ROOT CO_SIMULATION
               "<UnitDefinitions><Unit name='u'/>\n<Unit name='u'/></UnitDefinitions><ModelVariables/>" END,
               5, "unit|\"u\"|line 4");
    expect_bad(ROOT CO_SIMULATION "<TypeDefinitions><SimpleType name='T'><Real/></SimpleType>\n"
                                  "<SimpleType name='T'><Real/></SimpleType></TypeDefinitions><ModelVariables/>" END,
               5, "type|\"T\"|line 4");
}

/* Equal variables are dropped. Different ones of one name cannot be used. The order of the
 * document is kept. */
static void test_variables_declared_twice(void) {
    expect_ok(with_variables("<ScalarVariable name='v' valueReference='1'><Real/></ScalarVariable>"
                             "<ScalarVariable name='w' valueReference='2'><Real/></ScalarVariable>"
                             "<ScalarVariable name='a' valueReference='4'><Real/></ScalarVariable>"
                             "<ScalarVariable name='w' valueReference='2'><Real/></ScalarVariable>"
                             "<ScalarVariable name='v' valueReference='3'><Integer/></ScalarVariable>"
                             "<ScalarVariable name='v' valueReference='1'><Real/></ScalarVariable>"));
    static const struct {
        const char *name;
        bool is_ambiguous;
    } expected[] = {{"v", true}, {"w", false}, {"a", false}, {"v", true}, {"v", true}};
    TEST_ASSERT_EQUAL_size_t(5, model.variable_count);
    for (size_t i = 0; i < model.variable_count; i++) {
        TEST_ASSERT_EQUAL_STRING(expected[i].name, model.variables[i].name);
        TEST_ASSERT_EQUAL_INT(expected[i].is_ambiguous, model.variables[i].is_ambiguous);
    }
}

static void test_xml_that_is_not_well_formed(void) {
    expect_bad("", 1, "XML");
    expect_bad("no xml", 1, "XML|column 1");
    expect_bad(ROOT "<CoSimulation modelIdentifier='m'>\n", 4, "XML");
    expect_bad(ROOT CO_SIMULATION "</other>", 4, "XML|mismatched tag");
    expect_bad(ROOT "<CoSimulation modelIdentifier='m' modelIdentifier='m'/>", 3, "XML|duplicate attribute");
    expect_bad(ROOT CO_SIMULATION "&unknown;" END, 4, "XML|undefined entity");
    expect_bad("<?xml version='1.0' encoding='UTF-8'?><fmiModelDescription modelName='\xFF'/>", 1, "XML");
}

static void test_entities_cannot_expand(void) {
    expect_bad("<?xml version='1.0'?>\n<!DOCTYPE lolz [<!ENTITY a 'ha'><!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;'>"
               "<!ENTITY c '&b;&b;&b;&b;&b;&b;&b;&b;'>]>\n<fmiModelDescription modelName='&c;'/>",
               2, "<!DOCTYPE lolz>");
    expect_bad("<!DOCTYPE x SYSTEM 'http://localhost/x.dtd'>\n<x/>", 1, "<!DOCTYPE x>");
}

static void test_depth_and_size(void) {
    enum { DEEP = 100000 };
    char *xml = malloc(3 * (size_t)DEEP + sizeof ROOT);
    TEST_ASSERT_NOT_NULL(xml);
    size_t used = (size_t)sprintf(xml, ROOT);
    for (int i = 0; i < DEEP; i++) {
        memcpy(xml + used, "<a>", 4);
        used += 3;
    }
    expect_bad(xml, 3, "<a>|64");
    free(xml);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_model_description_parse("", (size_t)TL_MODEL_DESCRIPTION_BYTES + 1, "box.fmu",
                                                                  &arena, &model, &error));
    TL_EXPECT_PARTS("box.fmu|modelDescription.xml|512 MiB", error.text);
}

static void test_memory_is_out(void) {
    tl_arena_seal(&arena);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, parse(with_variables("")));
    TL_EXPECT_PARTS("box.fmu|modelDescription.xml|memory", error.text);
}

static void test_error_may_be_null(void) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_model_description_parse("<a/>", 4, "box.fmu", &arena, &model, NULL));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_model_description_read("/nowhere", "box.fmu", &arena, &model, NULL));
}

static void test_files(void) {
    tl_status status = tl_model_description_read(TL_SOURCE_DIR "/fmus/motor/modelDescription.xml", "motor.fmu", &arena,
                                                 &model, &error);
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
    TEST_ASSERT_EQUAL_INT(TL_TUNABLE, variable("d")->variability);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA,
                          tl_model_description_read(TL_SOURCE_DIR "/none.xml", "box.fmu", &arena, &model, &error));
    TL_EXPECT_PARTS("box.fmu|modelDescription.xml", error.text);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_model_description_read(TL_SOURCE_DIR, "box.fmu", &arena, &model, &error));
    TL_EXPECT_PARTS("box.fmu|modelDescription.xml|file", error.text);
}

/* The file is read in parts, and its text is not kept. */
static void test_a_large_file(void) {
    enum { SIZE = 65 * 1024 * 1024, PART = 1000 };
    tl_scratch scratch = {.folder = ""};
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_model_description");
    const char *path = tl_scratch_path(&scratch, "modelDescription.xml");
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fprintf(file, ROOT CO_SIMULATION "<ModelVariables>\n<!--%*d-->\n", SIZE / 2, 0);
    for (int i = 0; i < SIZE / PART; i++) {
        (void)fprintf(file, "<!--%*d-->\n", PART - 8, i);
    }
    (void)fputs("<ScalarVariable name='v' valueReference='7'><Real/></ScalarVariable></ModelVariables>" END, file);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_model_description_read(path, "large.fmu", &arena, &model, &error));
    TEST_ASSERT_EQUAL_UINT32(7, variable("v")->reference);
    TEST_ASSERT_LESS_THAN_size_t(1024 * 1024, tl_arena_used(&arena));
    tl_scratch_remove(&scratch);
}

/* Each prefix of a good document is rejected. A document with one changed byte is accepted or
 * rejected. */
static void test_damaged_documents(void) {
    char xml[1024];
    (void)snprintf(xml, sizeof xml,
                   ROOT CO_SIMULATION "<UnitDefinitions><Unit name='V'><BaseUnit kg='1'/></Unit></UnitDefinitions>"
                                      "<TypeDefinitions><SimpleType name='T'><Real unit='V'/></SimpleType>"
                                      "</TypeDefinitions><ModelVariables><ScalarVariable name='v' valueReference='1'>"
                                      "<Real declaredType='T' start='1'/></ScalarVariable></ModelVariables>" END);
    size_t length = strlen(xml);
    for (size_t i = 0; i + 2 < length; i++) {
        TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_model_description_parse(xml, i, "box.fmu", &arena, &model, &error));
    }
    for (size_t i = 0; i < length; i++) {
        char good = xml[i];
        static const char others[] = "<>'\"&/ 0x\n\xC3";
        for (size_t k = 0; k + 1 < sizeof others; k++) {
            xml[i] = others[k];
            tl_status status = tl_model_description_parse(xml, length, "box.fmu", &arena, &model, &error);
            TEST_ASSERT_TRUE(status == TL_OK || status == TL_BAD_DATA);
        }
        xml[i] = good;
    }
}

/* ---- Values of attributes -------------------------------------------------------------------- */

static void test_doubles(void) {
    static const struct {
        const char *text;
        double value;
    } good[] = {
        {"0", 0},      {"-0.0", -0.0},         {"1.", 1},   {".5", 0.5}, {"+3e+2", 300}, {" \t7\n", 7}, {"1E-3", 1e-3},
        {"00012", 12}, {"4.9e-324", 4.9e-324}, {"0.1", 0.1}};
    static const char *const bad[] = {"",   " ",   ".",   "e5",  "1e",    "1e+",   "--1", "1 2", "1_0",
                                      "1f", "Inf", "nan", "inf", "0x1p3", "1.2.3", "1d0", "+ 1", "1\xC2\xA0"};
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        double value = -1;
        TEST_ASSERT_TRUE_MESSAGE(tl_xml_double(good[i].text, &value), good[i].text);
        TEST_ASSERT_EQUAL_DOUBLE(good[i].value, value);
    }
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        double value = 42;
        TEST_ASSERT_FALSE_MESSAGE(tl_xml_double(bad[i], &value), bad[i]);
        TEST_ASSERT_EQUAL_DOUBLE(42, value);
    }
    double value = 0;
    TEST_ASSERT_TRUE(tl_xml_double("-INF", &value) && isinf(value) && value < 0);
    TEST_ASSERT_TRUE(tl_xml_double("1e400", &value) && isinf(value) && value > 0);
    TEST_ASSERT_TRUE(tl_xml_double("NaN", &value) && isnan(value));
}

static void test_doubles_in_a_locale_with_commas(void) {
    double value = 0;
    bool set = tl_comma_locale_set();
    tl_locale_use();
    bool understood = tl_xml_double("1.5", &value);
    (void)setlocale(LC_ALL, "C");
    TEST_ASSERT_TRUE_MESSAGE(set, "no locale with a decimal comma: run script/bootstrap");
    TEST_ASSERT_TRUE(understood);
    TEST_ASSERT_EQUAL_DOUBLE(1.5, value);
}

static void test_integers_and_booleans(void) {
    int64_t number = 0;
    bool flag = false;
    TEST_ASSERT_TRUE(tl_xml_integer(" -2147483648 ", INT32_MIN, INT32_MAX, &number) && number == INT32_MIN);
    TEST_ASSERT_TRUE(tl_xml_integer("+2147483647", INT32_MIN, INT32_MAX, &number) && number == INT32_MAX);
    TEST_ASSERT_TRUE(tl_xml_integer("-0", INT32_MIN, INT32_MAX, &number) && number == 0);
    TEST_ASSERT_FALSE(tl_xml_integer("2147483648", INT32_MIN, INT32_MAX, &number));
    TEST_ASSERT_FALSE(tl_xml_integer("99999999999999999999999999", INT32_MIN, INT32_MAX, &number));
    TEST_ASSERT_FALSE(tl_xml_integer("", INT32_MIN, INT32_MAX, &number));
    TEST_ASSERT_FALSE(tl_xml_integer("-", INT32_MIN, INT32_MAX, &number));
    TEST_ASSERT_FALSE(tl_xml_integer("1e3", INT32_MIN, INT32_MAX, &number));
    TEST_ASSERT_TRUE(tl_xml_integer("4294967295", 0, UINT32_MAX, &number) && number == UINT32_MAX);
    TEST_ASSERT_FALSE(tl_xml_integer("4294967296", 0, UINT32_MAX, &number));
    TEST_ASSERT_FALSE(tl_xml_integer("-1", 0, UINT32_MAX, &number));
    TEST_ASSERT_TRUE(tl_xml_boolean("1", &flag) && flag);
    TEST_ASSERT_TRUE(tl_xml_boolean(" false", &flag) && !flag);
    TEST_ASSERT_FALSE(tl_xml_boolean("TRUE", &flag));
    TEST_ASSERT_FALSE(tl_xml_boolean("", &flag));
}

static void test_names(void) {
    TEST_ASSERT_EQUAL_STRING("calculatedParameter", tl_causality_name(TL_CALCULATED_PARAMETER));
    TEST_ASSERT_EQUAL_STRING("tunable", tl_variability_name(TL_TUNABLE));
    TEST_ASSERT_EQUAL_STRING("approx", tl_initial_name(TL_INITIAL_APPROX));
    TEST_ASSERT_EQUAL_STRING("none", tl_initial_name(TL_INITIAL_NONE));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_root_and_capabilities);
    RUN_TEST(test_capabilities_default_to_false);
    RUN_TEST(test_variables_of_all_types);
    RUN_TEST(test_default_experiment);
    RUN_TEST(test_items);
    RUN_TEST(test_optional_attributes);
    RUN_TEST(test_defaults_of_variability_and_initial);
    RUN_TEST(test_units);
    RUN_TEST(test_declared_types_are_inherited);
    RUN_TEST(test_many_variables_and_aliases);
    RUN_TEST(test_unknown_elements_are_skipped);
    RUN_TEST(test_the_rounded_largest_double_is_no_limit);
    RUN_TEST(test_other_encodings);
    RUN_TEST(test_encodings_of_windows);
    RUN_TEST(test_encodings_that_are_refused);
    RUN_TEST(test_versions);
    RUN_TEST(test_mandatory_parts);
    RUN_TEST(test_identifiers_stay_in_their_folder);
    RUN_TEST(test_types_of_variables);
    RUN_TEST(test_numbers);
    RUN_TEST(test_words);
    RUN_TEST(test_names_given_twice);
    RUN_TEST(test_variables_declared_twice);
    RUN_TEST(test_xml_that_is_not_well_formed);
    RUN_TEST(test_entities_cannot_expand);
    RUN_TEST(test_depth_and_size);
    RUN_TEST(test_memory_is_out);
    RUN_TEST(test_error_may_be_null);
    RUN_TEST(test_files);
    RUN_TEST(test_a_large_file);
    RUN_TEST(test_damaged_documents);
    RUN_TEST(test_doubles);
    RUN_TEST(test_doubles_in_a_locale_with_commas);
    RUN_TEST(test_integers_and_booleans);
    RUN_TEST(test_names);
    return UNITY_END();
}

/* The schema of a twinlock database. config/SPEC.md, "Database", says what everything means; keep them together.
 *
 * Values of signals and variables are in columns without a type, on purpose: a column of type REAL stores 5.0 as the
 * integer 5, which makes 0.0 of -0.0, and a replay of a recording must see the same bits.
 */
#include "firmware/store/database_schema.h"

#include <stddef.h>

const char *const tl_database_schema[] = {
    /* Codes and their names; filled from the program's own names each time it opens the database for writing. */
    "CREATE TABLE outcomes (code INTEGER PRIMARY KEY, name TEXT NOT NULL)",
    "CREATE TABLE stops (code INTEGER PRIMARY KEY, name TEXT NOT NULL)",
    "CREATE TABLE qualities (code INTEGER PRIMARY KEY, name TEXT NOT NULL)",
    "CREATE TABLE severities (code INTEGER PRIMARY KEY, name TEXT NOT NULL)",
    "CREATE TABLE flags (bit INTEGER PRIMARY KEY, name TEXT NOT NULL)",

    "CREATE TABLE configurations ("
    "  hash TEXT PRIMARY KEY NOT NULL," /* SHA-256 of the text */
    "  text TEXT NOT NULL)",

    "CREATE TABLE runs ("
    "  run INTEGER PRIMARY KEY,"
    "  verb TEXT NOT NULL,"
    "  name TEXT NOT NULL,"
    "  version TEXT NOT NULL,"
    "  configuration TEXT NOT NULL REFERENCES configurations (hash),"
    "  started TEXT NOT NULL,"
    "  ended TEXT,"
    "  ended_reason TEXT,"
    "  committed TEXT,"
    "  step_ns INTEGER NOT NULL,"
    "  prediction INTEGER NOT NULL,"
    "  measurements TEXT NOT NULL,"
    "  samples_written INTEGER NOT NULL DEFAULT 0,"
    "  steps_written INTEGER NOT NULL DEFAULT 0,"
    "  events_written INTEGER NOT NULL DEFAULT 0,"
    "  entries_lost INTEGER NOT NULL DEFAULT 0,"
    "  removed_before INTEGER,"
    "  lead INTEGER NOT NULL DEFAULT 0)",

    "CREATE TABLE signals ("
    "  run INTEGER NOT NULL REFERENCES runs (run),"
    "  kind TEXT NOT NULL CHECK (kind IN ('plant', 'match', 'adjust')),"
    "  signal INTEGER NOT NULL,"
    "  name TEXT NOT NULL,"
    "  unit TEXT NOT NULL,"
    "  type TEXT NOT NULL,"
    "  compared_with TEXT,"
    "  PRIMARY KEY (run, kind, signal)) WITHOUT ROWID",

    "CREATE TABLE samples ("
    "  run INTEGER NOT NULL,"
    "  tick INTEGER NOT NULL,"
    "  signal INTEGER NOT NULL,"
    "  value,"
    "  quality INTEGER NOT NULL,"
    "  stamp_ns INTEGER,"
    "  PRIMARY KEY (run, tick, signal)) WITHOUT ROWID",

    "CREATE TABLE steps ("
    "  run INTEGER NOT NULL,"
    "  step INTEGER NOT NULL,"
    "  t_ns INTEGER NOT NULL,"
    "  outcome INTEGER NOT NULL,"
    "  stop INTEGER NOT NULL,"
    "  J,"
    "  J_nominal,"
    "  evaluations INTEGER NOT NULL,"
    "  executions INTEGER NOT NULL,"
    "  used_ns INTEGER NOT NULL,"
    "  predicted INTEGER," /* the recorder always writes these three, too */
    "  flags INTEGER,"
    "  held INTEGER,"
    "  PRIMARY KEY (run, step)) WITHOUT ROWID",

    "CREATE TABLE outputs ("
    "  run INTEGER NOT NULL,"
    "  step INTEGER NOT NULL,"
    "  signal INTEGER NOT NULL,"
    "  y,"
    "  y_hat,"
    "  quality INTEGER NOT NULL,"
    "  delta AS (y - y_hat),"
    "  readings INTEGER," /* the recorder always writes readings and rejected, too; squares is NULL if not finite */
    "  squares,"
    "  rejected INTEGER,"
    "  PRIMARY KEY (run, step, signal)) WITHOUT ROWID",

    "CREATE TABLE adjustments ("
    "  run INTEGER NOT NULL,"
    "  step INTEGER NOT NULL,"
    "  signal INTEGER NOT NULL,"
    "  u,"
    "  u_hat,"
    "  delta AS (u - u_hat),"
    "  PRIMARY KEY (run, step, signal)) WITHOUT ROWID",

    "CREATE TABLE components ("
    "  run INTEGER NOT NULL REFERENCES runs (run),"
    "  component INTEGER NOT NULL,"
    "  name TEXT NOT NULL,"
    "  plain INTEGER NOT NULL DEFAULT 0,"
    "  predicted INTEGER NOT NULL DEFAULT 0,"
    "  executions INTEGER NOT NULL DEFAULT 0,"
    "  caught_up INTEGER NOT NULL DEFAULT 0,"
    "  unstored INTEGER NOT NULL DEFAULT 0,"
    "  PRIMARY KEY (run, component)) WITHOUT ROWID",

    /* What a restart needs to resume a run. */
    "CREATE TABLE beginnings ("
    "  run INTEGER PRIMARY KEY REFERENCES runs (run),"
    "  fmus TEXT NOT NULL," /* SHA-256 over those of the files */
    "  boot TEXT NOT NULL," /* of the system; start_ns is of its clock */
    "  start_ns INTEGER,"
    "  resumed_run INTEGER,"
    "  resumed_tick INTEGER,"
    "  resumed_from TEXT)",

    "CREATE TABLE checkpoints ("
    "  run INTEGER NOT NULL REFERENCES runs (run),"
    "  tick INTEGER NOT NULL,"
    "  format TEXT NOT NULL,"
    "  sha256 TEXT NOT NULL,"
    "  bytes BLOB NOT NULL,"
    "  PRIMARY KEY (run, tick))",

    /* Configurations that a run took while it ran. */
    "CREATE TABLE tunings ("
    "  run INTEGER NOT NULL REFERENCES runs (run),"
    "  tick INTEGER NOT NULL," /* the first with it */
    "  configuration TEXT NOT NULL REFERENCES configurations (hash),"
    "  at TEXT NOT NULL,"
    "  who TEXT NOT NULL,"
    "  origin TEXT NOT NULL,"
    "  why TEXT NOT NULL,"
    "  PRIMARY KEY (run, tick)) WITHOUT ROWID",

    "CREATE TABLE events ("
    "  event INTEGER PRIMARY KEY,"
    "  run INTEGER NOT NULL,"
    "  at TEXT NOT NULL,"
    "  tick INTEGER,"
    "  severity INTEGER NOT NULL,"
    "  source TEXT NOT NULL,"
    "  text TEXT NOT NULL)",
    "CREATE INDEX events_of_run ON events (run, event)",

    "CREATE VIEW v_runs AS SELECT run, verb, name, started,"
    "  coalesce(ended, 'running') AS ended, ended_reason,"
    "  step_ns / 1e9 AS step_s, samples_written, steps_written, events_written, entries_lost, removed_before,"
    "  version, substr(configuration, 1, 12) AS configuration FROM runs",

    /* When the instant t_ns of a run was: only a live run has one in the world. */
    "CREATE VIEW v_samples AS SELECT s.run, s.tick, s.tick * r.step_ns / 1e9 AS time_s,"
    "  CASE r.verb WHEN 'run' THEN"
    "    strftime('%Y-%m-%dT%H:%M:%fZ', r.started, printf('%.3f seconds', s.tick * r.step_ns / 1e9)) END AS at,"
    "  n.name, s.value, n.unit, coalesce(q.name, s.quality) AS quality,"
    "  s.tick * r.step_ns / 1e9 - s.stamp_ns / 1e9 AS age_s"
    "  FROM samples s JOIN runs r USING (run)"
    "  LEFT JOIN signals n ON n.run = s.run AND n.kind = 'plant' AND n.signal = s.signal"
    "  LEFT JOIN qualities q ON q.code = s.quality",

    /* Bits as names; NULL if no bit is set. */
    "CREATE VIEW v_steps AS SELECT s.run, s.step, s.t_ns / 1e9 AS time_s,"
    "  CASE r.verb WHEN 'run' THEN"
    "    strftime('%Y-%m-%dT%H:%M:%fZ', r.started, printf('%.3f seconds', s.t_ns / 1e9)) END AS at,"
    "  coalesce(o.name, s.outcome) AS outcome, coalesce(t.name, s.stop) AS stop, s.J, s.J_nominal,"
    "  s.evaluations, s.executions, s.used_ns / 1e6 AS used_ms, s.predicted,"
    "  (SELECT group_concat(f.name, ', ') FROM flags f WHERE s.flags & f.bit) AS flags,"
    "  (SELECT group_concat(n.name, ', ') FROM signals n"
    "    WHERE n.run = s.run AND n.kind = 'adjust' AND (s.held >> n.signal) & 1) AS held"
    "  FROM steps s JOIN runs r USING (run)"
    "  LEFT JOIN outcomes o ON o.code = s.outcome LEFT JOIN stops t ON t.code = s.stop",

    "CREATE VIEW v_outputs AS SELECT s.run, s.step, (s.step + 1) * r.step_ns / 1e9 AS time_s,"
    "  CASE r.verb WHEN 'run' THEN"
    "    strftime('%Y-%m-%dT%H:%M:%fZ', r.started, printf('%.3f seconds', (s.step + 1) * r.step_ns / 1e9))"
    "  END AS at,"
    "  n.name, s.y, n.compared_with, s.y_hat, s.delta, n.unit, coalesce(q.name, s.quality) AS quality"
    "  FROM outputs s JOIN runs r USING (run)"
    "  LEFT JOIN signals n ON n.run = s.run AND n.kind = 'match' AND n.signal = s.signal"
    "  LEFT JOIN qualities q ON q.code = s.quality",

    "CREATE VIEW v_corrections AS SELECT s.run, s.step, s.step * r.step_ns / 1e9 AS time_s,"
    "  CASE r.verb WHEN 'run' THEN"
    "    strftime('%Y-%m-%dT%H:%M:%fZ', r.started, printf('%.3f seconds', s.step * r.step_ns / 1e9)) END AS at,"
    "  n.name, s.u, s.u_hat AS nominal, s.delta, n.unit"
    "  FROM adjustments s JOIN runs r USING (run)"
    "  LEFT JOIN signals n ON n.run = s.run AND n.kind = 'adjust' AND n.signal = s.signal",

    "CREATE VIEW v_events AS SELECT e.run, e.at, e.tick, coalesce(v.name, e.severity) AS severity, e.source, e.text"
    "  FROM events e LEFT JOIN severities v ON v.code = e.severity ORDER BY e.event",

    "CREATE VIEW v_ledger AS SELECT c.run, c.name AS component, c.plain, c.predicted, c.executions,"
    "  c.plain - c.executions AS saved, c.caught_up, c.unstored,"
    "  c.executions - c.caught_up - c.predicted AS difference"
    "  FROM components c ORDER BY c.run, c.component",

    "CREATE VIEW v_tunings AS SELECT t.run, t.tick, t.tick * r.step_ns / 1e9 AS time_s, t.at,"
    "  substr(t.configuration, 1, 12) AS configuration, t.who, t.origin, t.why"
    "  FROM tunings t JOIN runs r USING (run) ORDER BY t.run, t.tick",
    NULL,
};

const tl_database_key tl_database_keys[] = {
    {"configurations", "hash"},
    {"runs", "run"},
    {"signals", "run, kind, signal"},
    {"samples", "run, tick, signal"},
    {"steps", "run, step"},
    {"outputs", "run, step, signal"},
    {"adjustments", "run, step, signal"},
    {"components", "run, component"},
    {"beginnings", "run"},
    {"checkpoints", "run, tick"},
    {"tunings", "run, tick"},
    {"events", "event"},
    {"severities", "code"},
    {NULL, NULL},
};

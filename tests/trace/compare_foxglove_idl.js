// compare_foxglove_idl.js FILE: compares the types of idl/foxglove.idl with Foxglove's own schemas. Prints "equal", or the
// first type that differs.
"use strict";
const { isDeepStrictEqual } = require("util");
const { readFileSync } = require("fs");
const { dirname, join } = require("path");
const { parseIDL } = require("@foxglove/omgidl-parser");
// The package exports neither the generator of IDL nor the path to it.
const internal = join(dirname(require.resolve("@foxglove/schemas")), "internal");
const { generateOmgIdl } = require(join(internal, "generateOmgIdl.js"));
const { foxgloveMessageSchemas } = require(join(internal, "schemas.js"));

// Returns the IDL of a type after that of the types on which it depends.
function idlOf(schema, seen) {
  if (seen.has(schema.name)) return "";
  seen.add(schema.name);
  const used = (schema.fields ?? []).map(({ type }) => type.schema ?? type.enum).filter(Boolean);
  return used.map((each) => idlOf(each, seen)).join("") + generateOmgIdl(schema).replace(/^#include.*$/gm, "");
}

function typesOf(text) {
  return new Map(parseIDL(text).map((type) => [type.name, type]));
}

const seen = new Set();
const roots = ["SceneUpdate", "FrameTransforms", "Log"];
const theirs = typesOf(roots.map((name) => idlOf(foxgloveMessageSchemas[name], seen)).join(""));
const ours = typesOf(readFileSync(process.argv[2], "utf8"));
const names = new Set([...theirs.keys(), ...ours.keys()]);
const different = [...names].find((name) => !isDeepStrictEqual(ours.get(name), theirs.get(name)));
const text = (type) => JSON.stringify(type, undefined, 1);
if (theirs.size < 20) console.log(`found only ${theirs.size} types in @foxglove/schemas`);
else if (different === undefined) console.log("equal");
else console.log(`${different}: found ${text(ours.get(different))}, expected ${text(theirs.get(different))}`);

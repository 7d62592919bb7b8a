// Checks of a test: each prints its name, value and bound.
"use strict";
let failed = 0;

function check(name, value, holds, bound) {
  if (!holds) ++failed;
  console.log(`${name.padEnd(52)} ${String(value).padStart(14)}   ${bound.padEnd(12)} ${holds ? "holds" : "falls short"}`);
}

function report(name, value) {
  console.log(`${name.padEnd(52)} ${String(value).padStart(14)}   no bound`);
}

/// Exit status of the test. 0: all checks hold, 1: one falls short.
const exitStatus = () => failed > 0 ? 1 : 0;

const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

module.exports = { check, report, exitStatus, pause };

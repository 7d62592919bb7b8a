// The programs of a test. They end with it, also if a signal ends the test.
"use strict";
const { spawn } = require("child_process");
const { basename, join } = require("path");
const { pause } = require("../web/checks.js");

class Programs {
  /// `folder`: the folder of the programs.
  constructor(folder) {
    this.folder = folder;
    this.running = new Set();
    for (const signal of ["SIGINT", "SIGTERM"]) process.once(signal, () => this.end().then(() => process.exit(130)));
  }

  /// Starts a command in a process session of its own (setsid), because the kernel shares busy processors equally between
  /// these. `text` of the result is what it has printed so far; `ended` resolves to its exit status.
  spawn(command, options) {
    const program = spawn(command, options, { detached: true, stdio: ["ignore", "pipe", "pipe"] });
    program.text = "";
    for (const stream of [program.stdout, program.stderr]) stream.on("data", (bytes) => { program.text += bytes; });
    this.running.add(program);
    program.ended = new Promise((resolve) => {
      const end = (status) => {
        this.running.delete(program);
        resolve(status);
      };
      program.on("close", end);
      program.on("error", (error) => {
        program.text += error.message;
        program.hasFailed = true;
        end(null);
      });
    });
    return program;
  }

  /// Starts a program of Tactus.
  start(name, ...options) { return this.spawn(join(this.folder, `tactus-${name}`), options); }

  /// Waits until a program has printed a text, and returns the match.
  async printed(program, pattern, seconds = 20) {
    for (const began = performance.now(); !pattern.test(program.text); await pause(20))
      if (program.exitCode !== null || program.hasFailed || performance.now() - began > 1e3 * seconds)
        throw new Error(`${basename(program.spawnfile)} has not printed ${pattern}; it printed: ${program.text}`);
    return program.text.match(pattern);
  }

  /// Starts a viewer and returns it with the address of its page.
  async startViewer(pageFolder, port, ...options) {
    const viewer = this.start("view", "--page", pageFolder, "--port", port, ...options);
    const [address, number] = await this.printed(viewer, /http:\/\/localhost:(\d+)\//);
    return { viewer, address, port: number };
  }

  /// Prints the commands of the programs that run, with what they have printed.
  printAll() {
    for (const program of this.running) console.error(`${program.spawnargs.join(" ")}\n${program.text}`);
  }

  /// Ends all programs: by SIGTERM, after five seconds by SIGKILL. A script then has time to end its children.
  async end() {
    const all = [...this.running];
    for (const program of all) program.kill("SIGCONT") && program.kill("SIGTERM");
    const killer = setTimeout(() => all.forEach((program) => program.kill("SIGKILL")), 5e3);
    await Promise.all(all.map(({ ended }) => ended));
    clearTimeout(killer);
  }
}

module.exports = { Programs };

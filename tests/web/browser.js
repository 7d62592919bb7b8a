// Controls a headless Chromium by the DevTools protocol over two pipes.
"use strict";
const { spawn } = require("child_process");
const { mkdtempSync, rmSync } = require("fs");
const { tmpdir } = require("os");
const { join } = require("path");

const kStartMs = 1500;  // a new browser goes on starting for this long; the first page waits, so that its times are its own

class Browser {
  constructor(program) {
    this.profile = mkdtempSync(join(tmpdir(), "tactus-browser-"));
    // SwiftShader draws WebGL only. For text and buttons it would compile shaders first, half a second in which a page waits.
    // As root, Chromium would give itself a higher priority than the programs of the session have.
    this.process = spawn("setpriv", ["--bounding-set=-sys_nice", "--inh-caps=-sys_nice", program, "--remote-debugging-pipe", "--no-sandbox", "--use-angle=swiftshader", "--hide-scrollbars",
                                   "--enable-unsafe-swiftshader", "--disable-gpu-rasterization", `--user-data-dir=${this.profile}`],
                         { stdio: ["ignore", "ignore", "ignore", "pipe", "pipe"] });
    this.waiting = new Map();
    this.log = [];  // messages of the console, and errors
    this.next = 1;
    let text = "";
    this.process.stdio[4].on("data", (bytes) => {
      text += bytes;
      for (let end = text.indexOf("\0"); end >= 0; end = text.indexOf("\0")) {
        this.receive(JSON.parse(text.slice(0, end)));
        text = text.slice(end + 1);
      }
    });
    this.process.stdio[3].on("error", () => {});  // the browser has ended, which `end` reports
    this.process.on("error", (error) => this.end(new Error(`${program}: ${error.message}`)));
    this.process.on("exit", (status) => this.end(new Error(`${program} ended with status ${status}`)));
  }

  end(error) {
    this.ended = error;
    for (const { reject } of this.waiting.values()) reject(error);
    this.waiting.clear();
  }

  receive(message) {
    if (message.method === "Runtime.exceptionThrown") this.log.push(message.params.exceptionDetails.exception.description);
    if (message.method === "Runtime.consoleAPICalled" && message.params.type === "error")
      this.log.push(message.params.args.map((argument) => argument.value ?? argument.description).join(" "));
    const waiting = this.waiting.get(message.id);
    if (!waiting) return;
    this.waiting.delete(message.id);
    if (message.error) waiting.reject(new Error(message.error.message));
    else waiting.resolve(message.result);
  }

  send(method, params = {}) {
    return new Promise((resolve, reject) => {
      if (this.ended) return void reject(this.ended);
      const id = this.next++;
      this.waiting.set(id, { resolve, reject });
      this.process.stdio[3].write(JSON.stringify({ id, method, params, sessionId: this.session }) + "\0");
    });
  }

  /// Opens a page in a new tab. `script` runs before the scripts of the page.
  async open(address, width, height, script = "") {
    if (!this.session) await new Promise((resolve) => setTimeout(resolve, kStartMs));
    const { targetId } = await this.send("Target.createTarget", { url: "about:blank", width, height });
    this.session = (await this.send("Target.attachToTarget", { targetId, flatten: true })).sessionId;
    await this.send("Runtime.enable");
    await this.send("Page.enable");
    await this.send("Page.addScriptToEvaluateOnNewDocument", { source: script });
    await this.send("Page.navigate", { url: address });
  }

  /// Returns the value of an expression in the page.
  async value(expression) {
    const { result, exceptionDetails } = await this.send("Runtime.evaluate", { expression, returnByValue: true });
    if (exceptionDetails) throw new Error(exceptionDetails.exception.description);
    return result.value;
  }

  /// Waits until an expression is true. Throws after `seconds`.
  async until(expression, seconds) {
    const began = performance.now();
    while (!(await this.value(expression))) {
      if (performance.now() - began > 1e3 * seconds) throw new Error(`after ${seconds} s still not: ${expression}`);
      await new Promise((resolve) => setTimeout(resolve, 20));
    }
  }

  /// Presses and releases a key.
  async key(key) {
    for (const type of ["keyDown", "keyUp"]) await this.send("Input.dispatchKeyEvent", { type, key, text: key });
  }

  mouse(type, x, y, pressed) {
    return this.send("Input.dispatchMouseEvent", { type, x, y, button: type === "mouseMoved" ? "none" : "left",
                                                   buttons: pressed ? 1 : 0, clickCount: 1, pointerType: "mouse" });
  }

  async screenshot() {
    return Buffer.from((await this.send("Page.captureScreenshot", { format: "png" })).data, "base64");
  }

  close() {
    this.process.removeAllListeners("exit");
    this.process.kill("SIGKILL");
    rmSync(this.profile, { recursive: true, force: true, maxRetries: 5, retryDelay: 100 });
  }
}

module.exports = { Browser };

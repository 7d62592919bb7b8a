// containers_test.js [PODMAN_OPTION...]: starts the session of compose.yaml from the image localhost/tactus, opens the
// viewer's page in a headless browser, and kills each container in turn. After each, the page must name what happened,
// and all users must touch again. podman-compose passes the options on, for example --runtime runc.
// Prints each check. Exit status: 0 all hold, 1 one falls short, 2 the session could not be tried.
"use strict";
const { execFileSync } = require("child_process");
const { join } = require("path");
const { Browser } = require("../web/browser.js");

const kProject = "tactus-test", kUsers = 3;
const kHealSeconds = 30;
const podmanOptions = process.argv.slice(2);
const kCompose = ["-f", join(__dirname, "../../compose.yaml"), "-p", kProject,
                  ...podmanOptions.length > 0 ? [`--podman-args=${podmanOptions.join(" ")}`] : []];
const compose = (...options) => execFileSync("podman-compose", [...kCompose, ...options],
                                             { stdio: "pipe", env: { ...process.env, SECONDS_OF_TOUCH: "600" } });
/// Output of podman, on both streams.
const podman = (...options) =>
  execFileSync("sh", ["-c", 'podman "$@" 2>&1', "podman", ...options], { encoding: "utf8" }).trim();
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
let failed = 0;

function check(name, text, holds) {
  if (!holds) ++failed;
  console.log(`${name.padEnd(24)} ${holds ? "holds      " : "falls short"}  ${text}`);
}

/// Kills the program of a container. The restart policy of the container then starts it again.
function kill(service) {
  process.kill(Number(podman("inspect", "-f", "{{.State.Pid}}", `${kProject}_${service}_1`)), "SIGKILL");
}

/// Address of the page that may touch, as the viewer printed it.
async function pageAddress() {
  for (const began = performance.now(); performance.now() - began < 20e3; await pause(100)) {
    const address = podman("logs", `${kProject}_view_1`).match(/http:\/\/localhost:8090\/#\S+/);
    if (address) return address[0];
  }
  throw new Error(`no address of the page; found ${podman("logs", `${kProject}_view_1`)}`);
}

/// Waits until each user has touched exactly. Returns after how many seconds, or null if that took too long.
async function secondsUntilAllTouch(browser) {
  await browser.value(`{
    window.touched = new Set();
    clearInterval(window.watch);
    window.watch = setInterval(() => {
      for (const { user, status, age } of window.tactus.probes)
        if ((status & 3) === 3 && age < 0.2) window.touched.add(user);
    }, 5);
  }`);
  const began = performance.now();
  try {
    await browser.until(`window.touched.size >= ${kUsers}`, kHealSeconds);
    return (performance.now() - began) / 1e3;
  } catch {
    return null;
  }
}

/// The events since a time of the page's clock, as an expression. The page keeps only the newest events.
const eventsSince = (ms) => `window.tactus.scene.events.filter(({ secondsAgo }) =>
  window.tactus.scene.receivedMs - 1e3 * secondsAgo > ${ms}).map(({ text }) => text)`;
const pageTime = (browser) => browser.value("performance.now()");

/// Kills a container whose program is in the session as `name`.
async function killParticipant(browser, service, name) {
  const began = await pageTime(browser);
  kill(service);
  await browser.until(`${eventsSince(began)}.some((text) => text.endsWith("'${name}' joined"))`, kHealSeconds)
    .catch(() => {});
  const seconds = await secondsUntilAllTouch(browser);
  const said = (await browser.value(eventsSince(began))).filter((text) => text.includes(`'${name}'`));
  const isSaid = (words) => said.some((text) => text.endsWith(words));
  check(service, said.join("; "), isSaid("presumed failed") && isSaid("joined"));
  const healed = seconds === null ? `not all within ${kHealSeconds} s` : `all, after another ${seconds.toFixed(1)} s`;
  check(`${service}, users touch`, healed, seconds !== null);
}

async function run(browser) {
  compose("up", "-d");
  await browser.open(await pageAddress(), 800, 600);
  await browser.until("window.tactus?.scene?.objects.length === 2", 30);
  const first = await secondsUntilAllTouch(browser);
  check("start", first === null ? "not all users touch" : `all touch after ${first.toFixed(1)} s`, first !== null);

  for (const service of ["host-a", "host-b", "hrtc-1", "hrtc-2"]) await killParticipant(browser, service, service);
  await killParticipant(browser, "users", "sim");

  const began = await pageTime(browser);
  kill("discovery");
  const without = await secondsUntilAllTouch(browser);
  check("discovery, users touch", without === null ? "not all" : "all without it", without !== null);
  const returned = "discovery server 'discovery' is present again";
  await browser.until(`${eventsSince(began)}.includes("${returned}")`, kHealSeconds).catch(() => {});
  const said = (await browser.value(eventsSince(began))).filter((text) => text.includes("discovery server"));
  check("discovery", said.join("; "), said.some((text) => text.includes("is gone")) && said.includes(returned));
  await killParticipant(browser, "host-a", "host-a");  // a new program finds the others through the new server

  const connections = await browser.value("window.tactus.connections");
  kill("view");
  await browser.until("!window.tactus.isConnected", 10);
  const shown = await browser.value("document.getElementById('connection').textContent");
  await browser.until(`window.tactus.isConnected && window.tactus.connections > ${connections}`, kHealSeconds);
  const again = await secondsUntilAllTouch(browser);
  check("view", shown, shown !== "" && again !== null);
}

const browser = new Browser(process.env.CHROMIUM ?? "chromium-headless-shell");
run(browser).catch((error) => {
  const log = browser.log.join("; ") || "empty";
  console.error(`containers_test.js: ${error.message} ${error.stderr ?? ""}; console: ${log}`);
  failed = -1;
}).finally(() => {
  browser.close();
  try {
    compose("down");
  } catch (error) {
    console.error(`containers_test.js: the containers were not removed: ${error.message}`);
  }
  process.exit(failed < 0 ? 2 : failed > 0 ? 1 : 0);
});

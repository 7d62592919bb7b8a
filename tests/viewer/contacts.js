// Measures in the viewer's page how long after each new contact all faces within 1 mm of the probe have full resolution.
// The probe has a radius of 3 mm.
"use strict";
const { check, report } = require("../web/checks.js");

const kFineMs = 200;  // max time from a contact to faces of full resolution
const kGiveUpMs = 1000;

/// Statements for the page, which begin to measure.
const kWatchContacts = `{
  window.contacts = [];  // {user, object, proxy, began, ms: null while some faces are coarse}
  const touched = new Map();  // by user
  const watch = () => {
    const now = performance.now();
    for (const { user, status, object, proxy } of window.tactus.probes) {
      const isTouching = (status & 1) !== 0;
      if (isTouching && !touched.get(user)) window.contacts.push({ user, object, proxy: [...proxy], began: now, ms: null });
      touched.set(user, isTouching);
    }
    for (const contact of window.contacts)
      if (contact.ms === null && now - contact.began < ${kGiveUpMs} && window.tactus.isFineAt(contact.object, contact.proxy, 0.004)) contact.ms = now - contact.began;
    setTimeout(watch, 2);
  };
  watch();
}`;

/// `hasBound`: false on a machine that has too little time for the browser.
async function checkContacts(browser, hasBound = true) {
  // The newest contacts may not have had their time yet.
  const contacts = await browser.value(`window.contacts.filter(({ began }) => performance.now() - began > ${kFineMs})`);
  const slowest = Math.max(...contacts.map(({ ms }) => ms ?? Infinity));
  const name = `full resolution after a contact, slowest of ${contacts.length}`, text = `${slowest.toFixed(0)} ms`;
  if (hasBound) check(name, text, contacts.length >= 3 && slowest <= kFineMs, `<= ${kFineMs} ms`);
  else report(name, text);
}

module.exports = { checkContacts, kWatchContacts };

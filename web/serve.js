// serve.js FOLDER PORT: serves the files of FOLDER at http://localhost:PORT, to this machine only.
"use strict";
const { createServer } = require("http");
const { readFile } = require("fs");
const { basename, join } = require("path");

const kTypes = { html: "text/html; charset=utf-8", js: "text/javascript", css: "text/css", wasm: "application/wasm" };

/// Calls `done(address, server)` once the server is ready. Port 0: any free port. The folder has no subfolders.
function serve(folder, port, done) {
  const server = createServer((request, answer) => {
    const name = basename(request.url.split("?")[0]) || "index.html";
    readFile(join(folder, name), (error, bytes) => {
      answer.writeHead(error ? 404 : 200, { "Content-Type": kTypes[name.split(".").pop()] ?? "application/octet-stream",
                                            "Cache-Control": "no-store" });
      answer.end(error ? `${name}: not found\n` : bytes);
    });
  });
  server.on("error", (error) => {
    console.error(`serve.js: port ${port}: ${error.message}`);
    process.exit(2);
  });
  server.listen(port, "127.0.0.1", () => done(`http://localhost:${server.address().port}/`, server));
}

module.exports = { serve };
if (require.main === module) serve(process.argv[2], Number(process.argv[3]), () => {});

// read_mcap.js lines|decoded [stream] FILE: prints the messages that the reference reader finds. `lines` prints each
// message as topic, sequence number, times and hex. `decoded` prints JSON: for each topic the number of messages, and
// the last message, decoded by its schema. `stream` reads the file without its index, as required for a truncated file.
"use strict";
const { readFileSync } = require("fs");
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const { parseIDL } = require("@foxglove/omgidl-parser");
const { MessageReader } = require("@foxglove/omgidl-serialization");

async function* indexed(file) {
  const bytes = readFileSync(file);
  const readable = {
    size: async () => BigInt(bytes.length),
    read: async (offset, length) => new Uint8Array(bytes.subarray(Number(offset), Number(offset + length))),
  };
  const reader = await McapIndexedReader.Initialize({ readable });
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    const channel = reader.channelsById.get(message.channelId);
    yield { message, channel, schema: reader.schemasById.get(channel.schemaId) };
  }
}

function* streamed(file) {
  const reader = new McapStreamReader({ validateCrcs: true });
  reader.append(readFileSync(file));
  const schemas = new Map();
  const channels = new Map();
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "Schema") schemas.set(record.id, record);
    if (record.type === "Channel") channels.set(record.id, record);
    if (record.type !== "Message") continue;
    const channel = channels.get(record.channelId);
    yield { message: record, channel, schema: schemas.get(channel.schemaId) };
  }
}

async function main([format, ...source]) {
  const messages = source[0] === "stream" ? streamed(source[1]) : indexed(source[0]);
  const readers = new Map();
  const topics = {};
  for await (const { message, channel, schema } of messages) {
    if (format === "lines") {
      const hex = Buffer.from(message.data).toString("hex");
      console.log(`${channel.topic} ${message.sequence} ${message.logTime} ${message.publishTime} ${hex}`);
      continue;
    }
    if (!readers.has(schema.id))
      readers.set(schema.id, new MessageReader(schema.name, parseIDL(new TextDecoder().decode(schema.data))));
    const topic = (topics[channel.topic] ??= { count: 0, schema: schema.name });
    ++topic.count;
    topic.last = readers.get(schema.id).readMessage(message.data);
  }
  const plain = (key, value) =>
    typeof value === "bigint" ? value.toString() : ArrayBuffer.isView(value) ? Array.from(value) : value;
  if (format === "decoded") console.log(JSON.stringify(topics, plain));
}

main(process.argv.slice(2)).catch((error) => {
  console.error(`read_mcap.js: ${error.stack}`);
  process.exit(1);
});

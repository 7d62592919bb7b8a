// Joins screenshots (PNG) to one animated PNG. A frame contains only the pixels that differ from the one before.
// Format: PNG specification, third edition (W3C), with the chunks acTL, fcTL and fdAT.
"use strict";
const { deflateSync, inflateSync } = require("zlib");

const kCrcTable = Array.from({ length: 256 }, (_, n) => {
  for (let k = 0; k < 8; ++k) n = n & 1 ? 0xedb88320 ^ n >>> 1 : n >>> 1;
  return n >>> 0;
});

const kSignature = Buffer.from([0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a]);
const kRgb = 2, kRgba = 6;  // colour types

function crc(bytes) {
  let value = 0xffffffff;
  for (const byte of bytes) value = kCrcTable[(value ^ byte) & 0xff] ^ value >>> 8;
  return (value ^ 0xffffffff) >>> 0;
}

function chunk(type, data) {
  const bytes = Buffer.alloc(12 + data.length);
  bytes.writeUInt32BE(data.length, 0);
  bytes.write(type, 4, "latin1");
  data.copy(bytes, 8);
  bytes.writeUInt32BE(crc(bytes.subarray(4, 8 + data.length)), 8 + data.length);
  return bytes;
}

/// The predictor of filter 4 (Paeth 1991).
function paeth(left, up, corner) {
  const guess = left + up - corner;
  const toLeft = Math.abs(guess - left), toUp = Math.abs(guess - up), toCorner = Math.abs(guess - corner);
  return toLeft <= toUp && toLeft <= toCorner ? left : toUp <= toCorner ? up : corner;
}

/// Returns {width, height, pixels: r g b of each pixel} of a PNG with 8 bits a channel.
function decode(png) {
  const parts = [];
  let width = 0, height = 0, channels = 0;
  for (let at = 8; at < png.length;) {
    const size = png.readUInt32BE(at), type = png.toString("latin1", at + 4, at + 8), data = png.subarray(at + 8, at + 8 + size);
    if (type === "IHDR") {
      [width, height] = [data.readUInt32BE(0), data.readUInt32BE(4)];
      if (data[8] !== 8 || ![kRgb, kRgba].includes(data[9]) || data[12] !== 0)
        throw new Error("found a PNG of another kind, expected RGB or RGBA with 8 bits and no interlacing");
      channels = data[9] === kRgb ? 3 : 4;
    }
    if (type === "IDAT") parts.push(data);
    at += 12 + size;
  }
  const raw = inflateSync(Buffer.concat(parts)), stride = width * channels;
  const rows = new Uint8Array(height * stride), pixels = new Uint8Array(3 * width * height);
  for (let y = 0; y < height; ++y) {
    const filter = raw[y * (stride + 1)];
    for (let x = 0; x < stride; ++x) {
      const left = x >= channels ? rows[y * stride + x - channels] : 0, up = y > 0 ? rows[(y - 1) * stride + x] : 0;
      const corner = x >= channels && y > 0 ? rows[(y - 1) * stride + x - channels] : 0;
      const guess = [0, left, up, left + up >> 1, paeth(left, up, corner)][filter];
      rows[y * stride + x] = raw[y * (stride + 1) + 1 + x] + guess;
    }
  }
  for (let i = 0; i < width * height; ++i)
    for (let k = 0; k < 3; ++k) pixels[3 * i + k] = rows[channels * i + k];
  return { width, height, pixels };
}

/// The compressed pixels of a frame: opaque where it differs from `before`, otherwise transparent.
function compressedDifference({ width, height, pixels }, before) {
  const rows = Buffer.alloc(height * (1 + 4 * width));  // each row begins with its filter, 0
  for (let i = 0; i < width * height; ++i) {
    const differs = !before || [0, 1, 2].some((k) => pixels[3 * i + k] !== before.pixels[3 * i + k]);
    if (!differs) continue;
    const at = 1 + Math.floor(i / width) + 4 * i;
    for (let k = 0; k < 3; ++k) rows[at + k] = pixels[3 * i + k];
    rows[at + 3] = 255;
  }
  return deflateSync(rows, { level: 9 });
}

/// Returns an animated PNG that repeats without end. `pictures`: PNGs of equal size, each shown for `ms`.
function joinPictures(pictures, ms) {
  const frames = pictures.map(decode), [{ width, height }] = frames;
  const header = Buffer.alloc(13), count = Buffer.alloc(8);
  header.writeUInt32BE(width, 0);
  header.writeUInt32BE(height, 4);
  header.set([8, kRgba, 0, 0, 0], 8);
  count.writeUInt32BE(frames.length, 0);
  const chunks = [kSignature, chunk("IHDR", header), chunk("acTL", count)];
  let sequence = 0;
  frames.forEach((frame, i) => {
    const control = Buffer.alloc(26);
    control.writeUInt32BE(sequence++, 0);
    control.writeUInt32BE(width, 4);
    control.writeUInt32BE(height, 8);
    control.writeUInt16BE(Math.round(ms), 20);
    control.writeUInt16BE(1000, 22);
    control[25] = i === 0 ? 0 : 1;  // drawn over the frame before
    chunks.push(chunk("fcTL", control));
    const data = compressedDifference(frame, frames[i - 1]);
    if (i === 0) {
      chunks.push(chunk("IDAT", data));
      return;
    }
    const numbered = Buffer.alloc(4 + data.length);
    numbered.writeUInt32BE(sequence++, 0);
    data.copy(numbered, 4);
    chunks.push(chunk("fdAT", numbered));
  });
  return Buffer.concat([...chunks, chunk("IEND", Buffer.alloc(0))]);
}

module.exports = { joinPictures };

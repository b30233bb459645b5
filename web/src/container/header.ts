/** The header of a stream: fixed fields, symbol digests, CRC-32 (FORMAT.md, section 4). */

import { crc32, crcText } from "./crc32";
import { COPY_AGAIN, DAMAGED, hex, Refusal } from "./refusal";

const SIGNATURE = Uint8Array.of(0x89, 0x46, 0x43, 0x53, 0x0d, 0x0a, 0x1a, 0x0a);
const MAJOR = 2;
const FIXED_BYTES = 28;
const DIGEST_BYTES = 8;

export interface Header {
  /** First 8 bytes of the SHA-256 of the receiver's weights, in hexadecimal. */
  modelId: string;
  major: number;
  minor: number;
  views: number;
  stages: number;
  /** Size of every view in pixels. */
  height: number;
  width: number;
  /** Sides of the coding grid in pixels. */
  gridHeight: number;
  gridWidth: number;
  lambdaQ: number;
  sections: number;
  excess: number;
  /** Per stage, in hexadecimal. */
  digests: string[];
  /** Offset of the first section in bytes. */
  end: number;
}

/** Parse the header at the start of a stream. Throws Refusal for the first broken rule. */
export function readHeader(data: Uint8Array): Header {
  checkSignature(data);
  if (data.length >= 10) checkVersion(data[8], data[9]);
  requireLength(data, FIXED_BYTES);
  const stages = data[19];
  if (stages !== 1 && stages !== 2) {
    throw new Refusal(
      "number of stages",
      `header at byte 19: the number of stages is ${stages}, allowed are 1 to 2; ${DAMAGED}`,
    );
  }
  const crcAt = FIXED_BYTES + DIGEST_BYTES * stages;
  requireLength(data, crcAt + 4);
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  checkCrc(crc32(data.subarray(0, crcAt)), view.getUint32(crcAt, true));
  const header = fields(data, view, stages, crcAt + 4);
  checkLimits(header);
  return header;
}

/** Return the quantised lambda on which the networks of stage 1 or 2 are conditioned. */
export function lambdaOfStage(header: Header, stage: number): number {
  return header.lambdaQ + (stage === 1 ? 2 * header.excess : 0);
}

function fields(data: Uint8Array, view: DataView, stages: number, end: number): Header {
  const height = view.getUint16(20, true);
  const width = view.getUint16(22, true);
  const digests = Array.from({ length: stages }, (_, stage) => {
    const at = FIXED_BYTES + DIGEST_BYTES * stage;
    return hex(data.subarray(at, at + DIGEST_BYTES));
  });
  return {
    modelId: hex(data.subarray(10, 18)),
    major: data[8],
    minor: data[9],
    views: data[18],
    stages,
    height,
    width,
    gridHeight: gridSide(height),
    gridWidth: gridSide(width),
    lambdaQ: view.getUint16(24, true),
    sections: data[26],
    excess: data[27],
    digests,
    end,
  };
}

function gridSide(side: number): number {
  return 32 * Math.floor((side + 16) / 32);
}

function checkSignature(data: Uint8Array): void {
  const start = data.subarray(0, 8);
  const isPrefix = start.every((byte, at) => byte === SIGNATURE[at]);
  if (isPrefix) return requireLength(data, 8);
  if (String.fromCharCode(...start).includes("FCS")) {
    throw new Refusal(
      "the signature was not changed by text mode",
      "signature at byte 0: the file was changed as if it were text (line ends or high bits); " +
        "copy it again in binary mode.",
    );
  }
  throw new Refusal(
    "the stream starts with the signature",
    `not a .fcs file: its signature at byte 0 is ${hex(start, " ")} instead of ${hex(SIGNATURE, " ")}; ` +
      "give a file written by fecosplat encode.",
  );
}

function checkVersion(major: number, minor: number): void {
  if (major > MAJOR) {
    throw new Refusal(
      "major version is not above 2",
      `header at byte 8: format version ${major}.${minor} is newer than ${MAJOR}.x, which this program reads; ` +
        "install a newer fecosplat.",
    );
  }
  if (major < MAJOR) {
    throw new Refusal(
      "major version is not below 2",
      `header at byte 8: format version ${major}.${minor} was never released, this program reads ${MAJOR}.x; ` +
        "encode the photographs again.",
    );
  }
}

function requireLength(data: Uint8Array, needed: number): void {
  if (data.length >= needed) return;
  throw new Refusal(
    "the whole header is there",
    `header at byte 0: the file ends after ${data.length} bytes, the header needs ` +
      `${needed}; ${COPY_AGAIN}`,
  );
}

function checkCrc(found: number, stored: number): void {
  if (found === stored) return;
  throw new Refusal(
    "header CRC-32",
    `header at byte 0: CRC-32 is ${crcText(found)}, stored ${crcText(stored)}; ${DAMAGED}`,
  );
}

function checkLimits(header: Header): void {
  const limits: [number, string, string, number, number, number][] = [
    [18, "number of views", "number of views", header.views, 1, 16],
    [20, "height", "height", header.height, 64, 1024],
    [22, "width", "width", header.width, 64, 1024],
    [24, "lambda_q", "quantised lambda", header.lambdaQ, 0, 1768],
    [26, "number of sections", "number of sections", header.sections, 1 + header.stages, 16],
    [27, "excess of stage 1", "excess of stage 1", header.excess, 0, header.stages === 1 ? 0 : 255],
  ];
  for (const [offset, rule, name, value, lowest, highest] of limits) {
    if (value >= lowest && value <= highest) continue;
    throw new Refusal(
      rule,
      `header at byte ${offset}: the ${name} is ${value}, allowed are ${lowest} to ${highest}; ` +
        "encode the scene again within these limits.",
    );
  }
}

/** Sections of a stream: kind, length, CRC-32, payload, one after another (FORMAT.md, section 5). */

import { crc32, crcText } from "./crc32";
import type { Header } from "./header";
import { BAD_WRITER, COPY_AGAIN, DAMAGED, Refusal } from "./refusal";

export const Kind = {
  cameras: 0x90,
  coverage: 0x98,
  fading: 0x9c,
  b1: 0xa0,
  b2: 0xb0,
  detail: 0xb8,
  metadata: 0x40,
} as const;

const NAMES = new Map<number, string>([
  [Kind.cameras, "cameras"],
  [Kind.coverage, "coverage"],
  [Kind.fading, "fading"],
  [Kind.b1, "B1"],
  [Kind.b2, "B2"],
  [Kind.detail, "detail"],
  [Kind.metadata, "metadata"],
]);
const LONGEST = new Map<number, number>([
  [Kind.cameras, 2048],
  [Kind.coverage, 2 ** 18],
  [Kind.fading, 2 ** 15],
  [Kind.metadata, 65536],
]);
const LONGEST_OTHER = 2 ** 26;
const HEAD_BYTES = 9;
const CRITICAL = 0x80;

export interface Section {
  kind: number;
  name: string;
  /** Offset of the first byte and of the byte after the section. */
  offset: number;
  end: number;
  payload: Uint8Array;
}

export function sectionName(kind: number): string {
  return NAMES.get(kind) ?? `0x${kind.toString(16).padStart(2, "0")}`;
}

/** Return the start of messages about a section. */
export function place(section: { name: string; offset: number }): string {
  return `section ${section.name} at byte ${section.offset}`;
}

/** Read the sections up to and including the kind `last`, or all. Throws Refusal for the first broken rule. */
export function readSections(data: Uint8Array, header: Header, last: number | null): Section[] {
  const sections: Section[] = [];
  let offset = header.end;
  for (let count = 0; count < header.sections; count++) {
    const section = readSection(data, offset);
    checkKind(section, sections.at(-1), header);
    sections.push(section);
    offset = section.end;
    if (section.kind === last) break;
  }
  return sections;
}

function readSection(data: Uint8Array, offset: number): Section {
  if (data.length < offset + HEAD_BYTES) {
    throw new Refusal(
      "every section head is there",
      `section at byte ${offset}: the file ends after ${data.length} bytes, inside or before the head of a section ` +
        `that the header announces; ${COPY_AGAIN}`,
    );
  }
  const view = new DataView(data.buffer, data.byteOffset + offset, HEAD_BYTES);
  const kind = view.getUint8(0);
  const length = view.getUint32(1, true);
  const section = { kind, name: sectionName(kind), offset, end: offset + HEAD_BYTES + length };
  const limit = LONGEST.get(kind) ?? LONGEST_OTHER;
  if (length > limit) {
    throw new Refusal(
      "length within the limit",
      `${place(section)}: its length is ${length}, at most ${limit} bytes are allowed; ${DAMAGED}`,
    );
  }
  if (data.length < section.end) {
    throw new Refusal(
      "the whole payload is there",
      `${place(section)}: the file ends after ${data.length} bytes, but the section reaches to byte ${section.end}; ` +
        `the file is truncated, ${COPY_AGAIN}`,
    );
  }
  const payload = data.subarray(offset + HEAD_BYTES, section.end);
  const found = crc32(data.subarray(offset, offset + 5), payload);
  const stored = view.getUint32(5, true);
  if (found !== stored) {
    throw new Refusal(
      "section CRC-32",
      `${place(section)}: CRC-32 is ${crcText(found)}, stored ${crcText(stored)}; ${DAMAGED}`,
    );
  }
  return { ...section, payload };
}

function checkKind(section: Section, previous: Section | undefined, header: Header): void {
  const { kind } = section;
  if (!NAMES.has(kind) && NAMES.has(kind ^ CRITICAL)) {
    throw new Refusal(
      "critical bit of a known kind",
      `${place(section)}: the critical bit of this kind is wrong; ${BAD_WRITER}`,
    );
  }
  if (!NAMES.has(kind) && kind & CRITICAL) {
    throw new Refusal(
      "unknown kinds are not critical",
      `${place(section)}: this kind is unknown and marked as needed for decoding; install a newer fecosplat.`,
    );
  }
  if (previous && (kind & 0x7f) <= (previous.kind & 0x7f)) {
    const isTwice = kind === previous.kind;
    throw new Refusal(
      isTwice ? "no kind twice" : "ascending order",
      `${place(section)}: it ${isTwice ? "appears twice" : `must stand before section ${previous.name}`}; ${BAD_WRITER}`,
    );
  }
  if (kind === Kind.b2 && header.stages === 1) {
    throw new Refusal(
      "B2 only with two stages",
      `${place(section)}: the header announces 1 stage, this is one more; ${BAD_WRITER}`,
    );
  }
}

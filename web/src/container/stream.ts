/** A whole stream: its header and its sections (FORMAT.md, sections 3 and 9). */

import { checkCameras } from "./camera-rules";
import { readCameras, type StoredCameras } from "./cameras";
import { type Detail, readDetail } from "./detail";
import { type Header, readHeader } from "./header";
import { type Metadata, readMetadata } from "./metadata";
import { BAD_WRITER, Refusal } from "./refusal";
import { Kind, place, readSections, type Section, sectionName } from "./sections";
import { COVERAGE, FADING, readViewGrids } from "./view-grids";

export interface Stream {
  header: Header;
  cameras: StoredCameras;
  /** B1 and B2; fewer than the header announces if only a prefix was read. */
  payloads: Uint8Array[];
  /** One bit per cell; null if all cells are covered. */
  coverage: Uint8Array | null;
  /** Two bits per block; null if no block is faded. */
  fading: Uint8Array | null;
  /** Corrections to the Gaussians of the last stage; null if there are none or only a prefix was read. */
  detail: Detail | null;
  metadata: Metadata | null;
  sections: Section[];
}

/** Parse a whole stream and check every rule of the format. Throws Refusal for the first rule that it breaks. */
export function readStream(data: Uint8Array): Stream {
  const header = readHeader(data);
  const sections = readSections(data, header, null);
  const end = sections[sections.length - 1].end;
  if (end !== data.length) {
    throw new Refusal(
      "nothing follows",
      `end at byte ${end}: ${data.length - end} bytes follow the last section; the file is damaged or was joined with ` +
        "another, copy or encode it again.",
    );
  }
  const stream = assemble(header, sections, header.stages);
  const metadata = sections.find(({ kind }) => kind === Kind.metadata);
  return metadata ? { ...stream, metadata: readMetadata(metadata.payload, place(metadata)) } : stream;
}

/** Parse a stream up to the payload of the last of `stages` stages; what follows may be damaged or missing. */
export function readPrefix(data: Uint8Array, stages: 1 | 2): Stream {
  const header = readHeader(data);
  return assemble(header, readSections(data, header, stages === 1 ? Kind.b1 : Kind.b2), stages);
}

/**
 * Parse as many stages as are intact. damage: message about the first damage, null for an intact stream.
 * Throws Refusal if not even stage 1 is intact.
 */
export function readIntact(data: Uint8Array): { stream: Stream; damage: string | null } {
  try {
    return { stream: readStream(data), damage: null };
  } catch (error) {
    if (!(error instanceof Refusal)) throw error;
    const stream = longestPrefix(data);
    if (!stream) throw error;
    return { stream, damage: error.message };
  }
}

function longestPrefix(data: Uint8Array): Stream | null {
  for (const stages of [2, 1] as const) {
    try {
      return readPrefix(data, stages);
    } catch (error) {
      if (!(error instanceof Refusal)) throw error; // a shorter prefix may be intact
    }
  }
  return null;
}

function assemble(header: Header, sections: Section[], stages: number): Stream {
  const found = new Map(sections.map((section) => [section.kind, section]));
  const kinds = [Kind.b1, Kind.b2].slice(0, stages);
  for (const kind of [Kind.cameras, ...kinds]) {
    if (found.has(kind)) continue;
    throw new Refusal("cameras, B1, B2 are there", `section ${sectionName(kind)}: it is missing; ${BAD_WRITER}`);
  }
  const stored = found.get(Kind.cameras) as Section;
  const cameras = readCameras(stored.payload, header.views, place(stored));
  checkCameras(cameras, place(stored));
  const coverage = found.get(Kind.coverage);
  const fading = found.get(Kind.fading);
  const detail = found.get(Kind.detail);
  return {
    header,
    cameras,
    payloads: kinds.map((kind) => (found.get(kind) as Section).payload),
    coverage: coverage ? readViewGrids(COVERAGE, coverage.payload, header, place(coverage)) : null,
    fading: fading ? readViewGrids(FADING, fading.payload, header, place(fading)) : null,
    detail: detail ? readDetail(detail.payload, place(detail)) : null,
    metadata: null,
    sections,
  };
}

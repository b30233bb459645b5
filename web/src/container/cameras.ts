/** The camera section: cameras of all views as float32 values (FORMAT.md, section 6). */

import { inflate } from "./inflate";
import { BAD_WRITER, Refusal } from "./refusal";
import { floatOfBits, rotationOfWords } from "./rotation";

export interface StoredCamera {
  /** Camera-to-world rotation, row-major, OpenCV axes. */
  rotation: number[];
  /** Camera centre in scene units. */
  centre: number[];
  /** fx, fy, cx, cy, divided by image width (fx, cx) and height (fy, cy). */
  intrinsics: number[];
}

export interface StoredCameras {
  /** Bounds of depth in scene units. */
  near: number;
  far: number;
  views: StoredCamera[];
}

/** Parse the payload of the camera section; the values are not validated. place: start of messages. */
export function readCameras(payload: Uint8Array, views: number, place: string): StoredCameras {
  const content = inflate(payload, contentSize(views, views), place);
  const sets = content.length > 0 ? content[0] : 0;
  if (sets !== 1 && sets !== views) {
    throw new Refusal(
      "K is 1 or N",
      `${place}: it holds ${sets} sets of intrinsics for ${views} views, allowed are 1 and ${views}; ${BAD_WRITER}`,
    );
  }
  const expected = contentSize(views, sets);
  if (content.length !== expected) {
    throw new Refusal(
      "content size",
      `${place}: it inflates to ${content.length} bytes, ${views} views need ${expected}; ${BAD_WRITER}`,
    );
  }
  return camerasOfWords(wordsOfPlanes(content.subarray(1)), views, sets);
}

function contentSize(views: number, sets: number): number {
  return 1 + 4 * (2 + 4 * sets + 12 * views);
}

/** Return 32-bit words stored as four byte planes, the most significant first. */
function wordsOfPlanes(planes: Uint8Array): Uint32Array {
  const count = planes.length / 4;
  return Uint32Array.from({ length: count }, (_, i) =>
    [0, 1, 2, 3].reduce((word, plane) => ((word << 8) | planes[plane * count + i]) >>> 0, 0),
  );
}

function camerasOfWords(words: Uint32Array, views: number, sets: number): StoredCameras {
  /** Return the components of one view; components are stored view after view. */
  const components = (first: number, count: number, stride: number, view: number): number[] =>
    Array.from({ length: count }, (_, part) => words[first + part * stride + view]);
  const poses = 2 + 4 * sets;
  return {
    near: floatOfBits(words[0]),
    far: floatOfBits(words[1]),
    views: Array.from({ length: views }, (_, view) => ({
      rotation: rotationOfWords(components(poses, 9, views, view)),
      centre: components(poses + 9 * views, 3, views, view).map(floatOfBits),
      intrinsics: components(2, 4, sets, sets === 1 ? 0 : view).map(floatOfBits),
    })),
  };
}

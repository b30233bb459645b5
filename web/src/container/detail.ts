/** The section detail: a step of quantisation, then entropy-coded symbols (FORMAT.md, section 8.4). */

import { BAD_WRITER, Refusal } from "./refusal";

const MAX_STEP = 63;

export interface Detail {
  /** A symbol of 1 has the value 2^(-step / 8). */
  step: number;
  payload: Uint8Array;
}

/** Return the content of the section. place: start of messages. */
export function readDetail(content: Uint8Array, place: string): Detail {
  if (content.length === 0) {
    throw new Refusal("detail is not empty", `${place}: it is empty, it must hold a step; ${BAD_WRITER}`);
  }
  const step = content[0];
  if (step > MAX_STEP) {
    throw new Refusal(
      "step within its limit",
      `${place}: its step is ${step}, allowed are 0 to ${MAX_STEP}; ${BAD_WRITER}`,
    );
  }
  return { step, payload: content.subarray(1) };
}

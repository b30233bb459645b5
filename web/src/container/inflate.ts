/** Raw Deflate with a bound on the size of the result. Only this file imports pako. */

import { Inflate } from "pako";
import { BAD_WRITER, Refusal } from "./refusal";

/** Fields of pako's Inflate that its types leave out. */
interface Progress {
  ended: boolean;
  strm: { avail_in: number; next_out: number };
}

/** Inflate exactly one raw Deflate stream of at most `most` bytes. place: start of messages. Throws Refusal. */
export function inflate(payload: Uint8Array, most: number, place: string): Uint8Array {
  // The result fits into one chunk, so a full chunk is too long.
  const inflater = new Inflate({ raw: true, chunkSize: most + 1 });
  let content = new Uint8Array(0);
  inflater.onData = (chunk) => {
    content = chunk as Uint8Array<ArrayBuffer>;
    if (content.length > most) throw tooLong(most, place);
  };
  inflater.push(payload, false);
  const { ended, strm } = inflater as unknown as Progress;
  if (inflater.err) {
    const cause = inflater.msg || `error ${inflater.err}`;
    throw new Refusal("Deflate data valid", `${place}: no valid Deflate data (${cause}); ${BAD_WRITER}`);
  }
  if (!ended && strm.next_out > most) throw tooLong(most, place);
  if (!ended) throw new Refusal("Deflate data has an end", `${place}: its Deflate data has no end; ${BAD_WRITER}`);
  if (strm.avail_in > 0) {
    throw new Refusal(
      "nothing after the Deflate data",
      `${place}: ${strm.avail_in} bytes follow its Deflate data; ${BAD_WRITER}`,
    );
  }
  return content;
}

function tooLong(most: number, place: string): Refusal {
  return new Refusal(
    "Deflate data not too long",
    `${place}: it inflates to more than the ${most} bytes it may hold; ${BAD_WRITER}`,
  );
}

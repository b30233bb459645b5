/** The metadata section: a JSON object, compressed with zstd (FORMAT.md, section 8.3). Its strings are untrusted. */

import { BAD_WRITER, Refusal } from "./refusal";
import { frameContent, readFrame } from "./zstd-frame";

const MOST_BYTES = 65536;
const MOST_WINDOW = 2 ** 23;
const DEEPEST = 8;
const TOKEN = /"(?:[^"\\]|\\.)*"|[{}[\]:,]|[^\s{}[\]:,"]+/g;

export type Metadata = Record<string, unknown>;

/** Return the metadata of a payload. place: start of messages. Throws Refusal. */
export function readMetadata(payload: Uint8Array, place: string): Metadata {
  const content = unpack(payload, place);
  let value: unknown;
  try {
    const text = new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(content);
    value = JSON.parse(text);
    checkTokens(text);
  } catch (error) {
    throw new Refusal("JSON as in section 8", `${place}: no valid JSON (${causeOf(error)}); ${BAD_WRITER}`);
  }
  if (typeof value !== "object" || value === null || Array.isArray(value)) {
    throw new Refusal("the JSON is an object", `${place}: its JSON is not an object; ${BAD_WRITER}`);
  }
  return value as Metadata;
}

function unpack(payload: Uint8Array, place: string): Uint8Array {
  try {
    const frame = readFrame(payload);
    if (frame.contentSize === null || frame.contentSize > MOST_BYTES) {
      throw new Refusal(
        "stated content size",
        `${place}: its zstd frame does not state a size of at most ${MOST_BYTES} bytes; ${BAD_WRITER}`,
      );
    }
    if (frame.windowSize > MOST_WINDOW) {
      throw new Refusal(
        "window size",
        `${place}: its zstd frame has a window of ${frame.windowSize} bytes, at most ${MOST_WINDOW} are allowed; ` +
          BAD_WRITER,
      );
    }
    return frameContent(payload, frame);
  } catch (error) {
    if (error instanceof Refusal) throw error;
    throw new Refusal(
      "zstd frame valid, nothing after it",
      `${place}: no valid zstd frame (${causeOf(error)}); ${BAD_WRITER}`,
    );
  }
}

/** Check the rules beyond RFC 8259 on the tokens of valid JSON: depth, duplicate keys, numbers, surrogates. */
function checkTokens(text: string): void {
  const scopes: (Set<string> | null)[] = []; // keys of an object, null for a list
  const tokens = text.match(TOKEN) ?? [];
  tokens.forEach((token, at) => {
    if (token === "{" || token === "[") {
      scopes.push(token === "{" ? new Set() : null);
      if (scopes.length > DEEPEST) throw new Error(`it is nested more than ${DEEPEST} deep`);
    } else if (token === "}" || token === "]") {
      scopes.pop();
    } else if (token.startsWith('"')) {
      checkString(JSON.parse(token) as string, tokens[at + 1] === ":" ? scopes.at(-1) : null);
    } else if (!Number.isFinite(Number(token)) && /^[-\d]/.test(token)) {
      throw new Error(`the number ${token.length <= 20 ? token : token.slice(0, 20) + "..."} is too large`);
    }
  });
}

function checkString(value: string, keys: Set<string> | null | undefined): void {
  if (!value.isWellFormed()) throw new Error("a string has an unpaired surrogate");
  if (!keys) return;
  if (keys.has(value)) throw new Error("a key appears twice");
  keys.add(value);
}

function causeOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}

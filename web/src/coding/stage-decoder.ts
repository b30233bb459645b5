/** Decoding of the stages of a stream to latents, with the digests of the header (FORMAT.md, section 9, step 7). */

import { lambdaOfStage } from "../container/header";
import { Refusal } from "../container/refusal";
import type { Stream } from "../container/stream";
import { symbolDigest } from "../entropy/digest";
import type { Table } from "../entropy/tables";
import type { Field } from "./field";
import { decodeLatents, type Latents } from "./latent-decoder";
import type { PriorModel } from "./prior-model";

/** Decode stage 1 or 2. before: y_hat of stage 1 in stage 2, else null. Throws Refusal for a damaged payload. */
export function decodeStage(
  stream: Stream,
  stage: number,
  before: Field | null,
  model: PriorModel,
  tables: Table[],
): Latents {
  const { header } = stream;
  const size8 = [header.views, header.gridHeight / 8, header.gridWidth / 8] as const;
  const payload = stream.payloads[stage - 1];
  const latents = decodeLatents(model, tables, payload, size8, lambdaOfStage(header, stage), stage, before);
  const found = symbolDigest(latents.batches);
  const stored = header.digests[stage - 1];
  if (found !== stored) {
    throw new Refusal(
      "digest",
      `stage ${stage}: the decoded symbols have digest ${found}, the header says ${stored}; the file is damaged or was ` +
        "made by a faulty encoder, copy or encode it again.",
    );
  }
  return latents;
}

/** Return the refusal of a stream whose model is not among the known ones. */
export function unknownModel(modelId: string, known: string[]): Refusal {
  return new Refusal(
    "model id",
    `the stream needs the receiver weights with model id ${modelId}, but this page has ${known.join(", ") || "none"}; ` +
      "open it with the version of fecosplat that made the file.",
  );
}

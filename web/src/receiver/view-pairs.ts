/** Run graphs that compare the Gaussians of one view with another view of the scene. */

import type { GraphName } from "./graph-names";
import { floats, floatsOf, type Graphs, type Tensors } from "./graphs";

/**
 * Run a graph once for every pair of views, and return its results. Their first axis is the view, as in `start`.
 *
 * ofViews: inputs, whose first axis is the view: NAME of the view itself, NAME_there of the other view. start: results
 * before the first run; every run takes those of the run before, as NAME, and returns NAME_after.
 */
export async function runOverPairs(
  graphs: Graphs,
  graph: GraphName,
  ofViews: Tensors,
  start: Tensors,
): Promise<Tensors> {
  const names = Object.keys(start);
  const views = start[names[0]].dims[0];
  const results = Object.fromEntries(names.map((name) => [name, new Float32Array(start[name].size)]));
  for (let view = 0; view < views; view++) {
    const own = entriesOf(ofViews, view);
    let sums = entriesOf(start, view);
    for (let shift = 1; shift < views; shift++) {
      const other = Object.entries(entriesOf(ofViews, (view + shift) % views));
      const there = Object.fromEntries(other.map(([name, tensor]) => [`${name}_there`, tensor]));
      const after = await graphs.run(graph, { ...own, ...there, ...sums });
      sums = Object.fromEntries(names.map((name) => [name, after[`${name}_after`]]));
    }
    for (const name of names) results[name].set(floatsOf(sums[name]), view * sums[name].size);
  }
  return Object.fromEntries(names.map((name) => [name, floats(results[name], start[name].dims)]));
}

/** Return one entry of the first axis of each tensor. */
function entriesOf(tensors: Tensors, at: number): Tensors {
  const entries = Object.entries(tensors).map(([name, tensor]) => {
    const size = tensor.size / tensor.dims[0];
    return [name, floats(floatsOf(tensor).subarray(at * size, (at + 1) * size), tensor.dims.slice(1))];
  });
  return Object.fromEntries(entries) as Tensors;
}

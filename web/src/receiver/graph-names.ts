/** Names of the graphs that the decoder runs; the entropy model has its own implementation. */

export const GRAPHS = ["update", "points", "attend", "attributes", "confirm", "free_space", "duplicates", "slope", "harmonics"] as const;
export type GraphName = (typeof GRAPHS)[number];

/** Entry `index` of a list that has one. */
export function at<T>(list: readonly T[], index: number): T {
  const found = list[index];
  if (found === undefined) throw new Error(`there is no entry ${index} of ${list.length}`);
  return found;
}

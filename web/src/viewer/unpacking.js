/** Return the bytes that `packed` of build.mjs made text of. */
function bytesOfText(text) {
  const words = new DataView(new ArrayBuffer(((text.length - 1) / 5) * 4));
  for (let at = 0; at < words.byteLength; at += 4) {
    let word = 0;
    for (let digit = 0; digit < 5; digit++) {
      const code = text.charCodeAt(1 + (at / 4) * 5 + digit);
      word = 85 * word + (code === 33 ? 60 : code) - 40;
    }
    words.setUint32(at, word);
  }
  return new Uint8Array(words.buffer, 0, words.byteLength - Number(text[0]));
}

// The page's elements, messages to the user, and questions to the server.

/** Returns an element of index.html; that it is there is the page's own affair. */
export function element<T extends HTMLElement>(id: string, type: { new (): T }): T {
  const found = document.getElementById(id);
  if (!(found instanceof type)) throw new Error(`the page has no ${type.name} #${id}`);
  return found;
}

const shown = new Map<string, HTMLElement>();

/** Shows a message until it is dismissed; another one with the same key takes its place. */
export function tell(key: string, text: string, kind: "error" | "note" = "error"): void {
  let line = shown.get(key);
  if (!line) {
    line = document.createElement("div");
    const words = document.createElement("span");
    const close = document.createElement("button");
    close.textContent = "✕";
    close.title = "Dismiss";
    close.addEventListener("click", () => line?.remove());
    line.append(words, close);
    shown.set(key, line);
  }
  line.className = kind;
  line.firstElementChild!.textContent = text;
  element("messages", HTMLDivElement).append(line);
}

/** Replaces the page by a message: nothing can be shown. */
export function giveUp(text: string): void {
  const cover = element("cover", HTMLDivElement);
  cover.hidden = false;
  cover.classList.add("failed");
  element("cover-text", HTMLParagraphElement).textContent = text;
}

export function reason(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}

/** Asks the server; a refusal becomes an error with the server's words. */
export async function ask(path: string, method = "GET", body?: unknown): Promise<Response> {
  const init: RequestInit = { method };
  if (body !== undefined) {
    init.headers = { "content-type": "application/json" };
    init.body = JSON.stringify(body);
  }
  let response: Response;
  try {
    response = await fetch(path, init);
  } catch {
    throw new Error("the server does not answer; is `adit view` still running?");
  }
  if (response.ok) return response;
  const text = await response.text();
  let words = text;
  try {
    words = (JSON.parse(text) as { error?: string }).error ?? text;
  } catch {
    // Not JSON: the words are the text.
  }
  throw new Error(words || `${path}: ${response.status}`);
}

export async function askJson<T>(path: string, method = "GET", body?: unknown): Promise<T> {
  return (await (await ask(path, method, body)).json()) as T;
}

/** Decodes a picture of the server without colour management: what is shown is what the file holds. */
export async function picture(path: string, most_px = Infinity): Promise<ImageBitmap> {
  const blob = await (await ask(path)).blob();
  const options: ImageBitmapOptions = { premultiplyAlpha: "none", colorSpaceConversion: "none" };
  try {
    const full = await createImageBitmap(blob, options);
    const factor = most_px / Math.max(full.width, full.height);
    if (factor >= 1) return full;
    const size = { resizeWidth: Math.max(1, Math.round(full.width * factor)), resizeHeight: Math.max(1, Math.round(full.height * factor)) };
    return await createImageBitmap(full, { ...options, ...size });
  } catch {
    throw new Error("not a picture that the browser can decode");
  }
}

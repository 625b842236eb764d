// Searching in pages opened from the disk: there a browser starts no worker, so a hidden frame does its work.
if (location.protocol === "file:") {
  window.IFrameWorker = window.Worker = class extends EventTarget {
    constructor(script) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      const source = new URL(script, document.baseURI).href.replaceAll('"', "%22");
      frame.srcdoc = `<script>postMessage = (data) => frameElement.answer(data)</script><script src="${source}"></script>`;
      frame.answer = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      this.ready = new Promise((done) => frame.addEventListener("load", () => done(frame.contentWindow)));
      document.documentElement.append(frame);
    }

    postMessage(data) {
      this.ready.then((inside) => inside.dispatchEvent(new MessageEvent("message", { data })));
    }
  };
}

/*
 * Search for pages that are opened from the disk. Browsers start no worker from file://, so its
 * script runs in a hidden frame that looks like one.
 */
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      this.waiting = []
      this.scope = null
      const frame = document.createElement("iframe")
      frame.hidden = true
      frame.srcdoc = "<!doctype html><title>search</title>"
      frame.addEventListener("load", () => this.start(frame.contentWindow, url), {once: true})
      document.addEventListener("DOMContentLoaded", () => document.body.append(frame))
      if (document.body) document.body.append(frame)
    }

    start(scope, url) {
      const load = source => new Promise((done, fail) => {
        const script = scope.document.createElement("script")
        script.src = source
        script.onload = done
        script.onerror = fail
        scope.document.head.append(script)
      })
      scope.importScripts = (...sources) =>
        sources.reduce((before, source) => before.then(() => load(source)), Promise.resolve())
      scope.postMessage = data => {
        const event = new MessageEvent("message", {data})
        this.dispatchEvent(event)
        if (this.onmessage) this.onmessage(event)
      }
      load(url).then(() => {
        this.scope = scope
        this.waiting.splice(0).forEach(data => this.postMessage(data))
      })
    }

    postMessage(data) {
      if (!this.scope) return void this.waiting.push(data)
      this.scope.dispatchEvent(new this.scope.MessageEvent("message", {data}))
    }

    terminate() {
      this.scope = null
    }
  }
}
